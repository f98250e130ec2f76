"""A page in which the closed loop runs as WebAssembly, with a slider for each tunable value: one file, no server.

Read `settings` for the content of a page, `loop_program` for the loop in WebAssembly, `playground` for the page itself.
"""

from .playground import built_in as built_in
from .playground import of_scenario as of_scenario
from .playground import page_text as page_text
from .playground import playground as playground
from .playground import write_page as write_page
