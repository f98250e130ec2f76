"""The first scenario of an arm: what its file says, what had to be assumed, where it stands and how it moves."""

from .scenario import Drafted as Drafted
from .scenario import draft as draft
