"""Arms that need no file: the numbers of their makers and of published identifications, each with its source.

Each is a file in this folder: a further one, `NAME.yaml`, is a further arm, `slidax.robots.NAME()`.
"""

from .read import Ready as Ready
from .read import maker as maker
from .read import names as names
from .read import read as read
from .read import title as title
