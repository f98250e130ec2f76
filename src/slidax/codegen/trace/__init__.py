"""Convert a pure JAX function to the intermediate representation, by its jaxpr."""

from .library import Library as Library
from .tracing import Origin as Origin
from .tracing import inline as inline
from .tracing import trace as trace
