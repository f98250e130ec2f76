"""A closed loop as a page: the same generated code in a browser, with sliders for what can be moved."""

from .page_text import page_text as page_text
