"""Convert a pure JAX function to a program of the intermediate representation (IR), from its jaxpr."""

from .library import Library as Library
from .tracing import Origin as Origin
from .tracing import inline as inline
from .tracing import trace as trace
