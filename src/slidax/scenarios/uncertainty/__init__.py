"""Uncertainty of a scenario: sets of values by path, as an image of the unit cube."""

from .leaf import Leaf as Leaf
from .leaf import leaf_of as leaf_of
from .leaf import with_values as with_values
from .sets import AbstractSet as AbstractSet
from .sets import AnySet as AnySet
from .space import Space as Space
