"""From a pure JAX function to the intermediate form, by its jaxpr."""

from .inline import inline as inline
from .origin import Origin as Origin
from .trace import trace as trace
