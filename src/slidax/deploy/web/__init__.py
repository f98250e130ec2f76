"""A page in which a closed loop runs as WebAssembly: arms, laws and sliders in one file, without a server."""

from .built_in import built_in as built_in
from .export import of_scenario as of_scenario
from .export import write_page as write_page
from .page_text import page_text as page_text
from .playground import playground as playground

__all__ = ["built_in", "of_scenario", "page_text", "playground", "write_page"]
