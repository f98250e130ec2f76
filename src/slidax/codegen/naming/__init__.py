"""Take names and comments for generated code from the Python source."""

from .identifiers import identifier as identifier
from .names import Name as Name
from .names import Names as Names
from .plain_text import plain as plain
