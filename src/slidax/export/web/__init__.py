"""A page in which the closed loop runs as WebAssembly, with a slider for each tunable value: one file, no server.

The manifest is the JSON data of a page: arms, settings (one arm with one scheme each) and programs. Read `settings` for
the content of a page, `loop_program` for the loop in WebAssembly, `playground` for the page itself.
"""

from .playground import manifest_of_all as manifest_of_all
from .playground import manifest_of_scenario as manifest_of_scenario
from .playground import page_text as page_text
from .playground import playground as playground
from .playground import write_playground as write_playground
