"""Dense linear algebra for small sizes: a library call in a scanned step would cost five times the whole step."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Matrix, Vector

from .once import once


@jax.jit
def matvec(a: Matrix, x: Vector) -> Vector:
    """`A x` as broadcast and sum.

    - `a`: matrix [n n].
    - `x`: vector [n].
    """
    return jnp.sum(a * x[None, :], axis=1)


def solve_symmetric(a: Matrix, b: Vector) -> Vector:
    """The solution x of `A x = b` by `A = L D Lᵀ` without pivoting, unrolled over the fixed size.

    Column by column: the update of A and b is one operation on arrays. There are few operations to trace and compile,
    and each depends on the previous column only.

    - `a`: symmetric positive definite matrix [n n]; only the lower triangle is read.
    - `b`: right-hand side [n].
    """
    return _substituted(*_factors(a), b)


# jit's memory saves tracing them anew, and in exported C each stays a function.
@jax.jit
def _factors(a: Matrix) -> tuple[Matrix, Vector]:
    """The rows of Lᵀ, without its ones, and the inverses of D."""
    n = a.shape[0]
    rows: list[jnp.ndarray] = []
    inverses: list[jnp.ndarray] = []
    for size in range(n, 0, -1):
        first = jax.lax.slice_in_dim(a, 0, 1, axis=1)
        pivot, below = jax.lax.slice_in_dim(first, 0, 1), jax.lax.slice_in_dim(first, 1, size)
        inverse = 1.0 / pivot
        column = below * inverse
        row = column.T
        rows.append(jax.lax.pad(row, jnp.zeros((), row.dtype), ((0, 0, 0), (n - size + 1, 0, 0))))
        inverses.append(inverse[0])
        a = once(jax.lax.slice(a, (1, 1), (size, size)) - (column * pivot) * row)
    upper, inverse = once((jnp.concatenate(rows), jnp.concatenate(inverses)))
    return upper, inverse


@jax.jit
def _substituted(upper: Matrix, inverses: Vector, b: Vector) -> Vector:
    """The solution of `L D Lᵀ x = b`."""
    n = b.shape[0]
    y: list[jnp.ndarray] = []
    for i in range(n):
        top = jax.lax.slice_in_dim(b, 0, 1)
        y.append(top * inverses[i])
        b = once(jax.lax.slice_in_dim(b, 1, n - i) - jax.lax.slice(upper, (i, i + 1), (i + 1, n))[0] * top)
    left = once(jnp.concatenate(y))
    x: list[jnp.ndarray] = []
    for i in reversed(range(n)):
        x.append(jax.lax.slice_in_dim(left, i, i + 1))
        left = once(jax.lax.slice_in_dim(left, 0, i) - jax.lax.slice(upper, (0, i), (i, i + 1))[:, 0] * x[-1])
    return jnp.concatenate(x[::-1])


def is_positive_definite(a: np.ndarray) -> bool:
    """True if a matrix of known numbers is symmetric and positive definite.

    - `a`: matrix [n n].
    """
    return bool(np.allclose(a, a.T, rtol=1e-12, atol=0.0) and np.all(np.linalg.eigvalsh(a) > 0))
