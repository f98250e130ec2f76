"""From a pure JAX function to the intermediate representation, by its jaxpr."""

from .inline import inline as inline
from .library import Library as Library
from .origin import Origin as Origin
from .trace import trace as trace
