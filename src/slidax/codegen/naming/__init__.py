"""Names and comments for generated code, taken from the Python source."""

from .names import Name as Name
from .names import Names as Names
from .names import identifier as identifier
from .source_text import to_ascii as to_ascii
