"""Random numbers from a seed and a sample number, identical in every simulator."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Int, Key

from slidax.core.errors import DefinitionError, short_repr
from slidax.core.parameter import parameter

# Each kind of sensor has its own random stream, so nested sensors with the same seed are uncorrelated.
ENCODERS, DIFFERENCED_ENCODERS, DELAYED, LOSSY = 1, 2, 3, 4


def as_integer(value: Any) -> Array:
    """Convert an integer, a list of integers or an array to a JAX array of integers, which a batch can vary.

    Raises DefinitionError for a number that is not an integer.
    """
    is_array = isinstance(value, jax.Array)
    number = value if is_array else np.asarray(value)
    if number.size and not np.issubdtype(number.dtype, np.integer):
        raise DefinitionError(f"a whole number or a list of whole numbers is needed; got {short_repr(value)}")
    if is_array:
        return value
    return jax.device_put(number.astype(int))


def seed(effect: str) -> Any:
    """Return the declaration of a sensor's field `seed`.

    - `effect`: the random effect that the field's description names, such as "noise".
    """
    return parameter(f"a whole number; another seed gives other {effect}", default=0, converter=as_integer)


def _key(seed: Int[Array, ""], stream: int, k: Int[Array, ""]) -> Key[Array, ""]:
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), stream), k)


def draw_normal(seed: Int[Array, ""], stream: int, k: Int[Array, ""], shape: tuple[int, ...]) -> Float[Array, "..."]:
    """Draw independent normal numbers with mean 0 and standard deviation 1.

    - `stream`: number of the random stream, a different one for each kind of sensor.
    - `k`: number of the sample.
    - `shape`: shape of the result.
    """
    return jax.random.normal(_key(seed, stream, k), shape, float)


def draw_uniform(seed: Int[Array, ""], stream: int, k: Int[Array, ""]) -> Float[Array, ""]:
    """Draw a uniform random number in [0, 1).

    - `stream`: number of the random stream, a different one for each kind of sensor.
    - `k`: number of the sample.
    """
    return jax.random.uniform(_key(seed, stream, k), (), float)
