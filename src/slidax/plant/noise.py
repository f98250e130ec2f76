"""Random numbers from a seed and a sample number, the same bits in every engine."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Int, Key

from slidax.core.errors import DefinitionError, short_repr
from slidax.core.parameter import parameter

# One stream of random numbers for each kind of sensor: a chain of sensors with one seed is not correlated with itself.
ENCODERS, DIFFERENCED_ENCODERS, DELAYED, LOSSY = 1, 2, 3, 4


def as_integer(value: Any) -> Array:
    """Convert integers and lists of them to int arrays, so that a batch can vary them.

    - `value`: a whole number, a list of them or an array.

    Raises DefinitionError if one of them is not whole.
    """
    if isinstance(value, jax.Array):
        return value
    number = np.asarray(value)
    if number.size and not np.issubdtype(number.dtype, np.integer):
        raise DefinitionError(f"a whole number or a list of whole numbers is needed; got {short_repr(value)}")
    return jax.device_put(number.astype(int))


def seed(chances: str) -> Any:
    """Declare a seed of `chances`."""
    return parameter(f"a whole number; another seed gives other {chances}", default=0, converter=as_integer)


def _key(seed: Int[Array, ""], stream: int, k: Int[Array, ""]) -> Key[Array, ""]:
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), stream), k)


def draw_normal(seed: Int[Array, ""], stream: int, k: Int[Array, ""], shape: tuple[int, ...]) -> Float[Array, "..."]:
    """Independent numbers with mean 0 and standard deviation 1.

    - `stream`: number for the kind of sensor.
    - `k`: number of the sample.
    - `shape`: of the result.
    """
    return jax.random.normal(_key(seed, stream, k), shape, float)


def draw_uniform(seed: Int[Array, ""], stream: int, k: Int[Array, ""]) -> Float[Array, ""]:
    """A uniform random number in [0, 1).

    - `stream`: number for the kind of sensor.
    - `k`: number of the sample.
    """
    return jax.random.uniform(_key(seed, stream, k), (), float)
