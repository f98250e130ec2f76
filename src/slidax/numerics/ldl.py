"""Small dense algebra, written out: a library call inside a scanned step would cost five times the whole step."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from slidax._types import Matrix, Vector

from .once import once


def matvec(a: Matrix, x: Vector) -> Vector:
    """`A x` as broadcast and sum.

    - `a`: matrix [n n].
    - `x`: vector [n].
    """
    return jnp.sum(a * x[None, :], axis=1)


def solve_symmetric(a: Matrix, b: Vector) -> Vector:
    """The solution x of `A x = b` by `A = L D Lᵀ` without pivoting, unrolled over the fixed size.

    Column by column: what is left of A and b after each is one operation on arrays, so that there are few to trace and
    to compile, and nothing waits for more than the column before.

    - `a`: symmetric positive definite matrix [n n]; only the lower triangle is read.
    - `b`: right-hand side [n].
    """
    n = b.shape[0]
    columns: list[jnp.ndarray] = []
    halves: list[jnp.ndarray] = []  # of D⁻¹ L⁻¹ b
    for _ in range(n):
        pivot = a[0, 0]
        # The inverses do not wait for b, which in a control loop comes last.
        inverse = 1.0 / pivot
        column = a[1:, 0] * inverse
        columns.append(column)
        halves.append(b[0] * inverse)
        a, b = once((a[1:, 1:] - (column * pivot)[:, None] * column[None, :], b[1:] - column * b[0]))
    x: list[jnp.ndarray] = []
    y = jnp.stack(halves)
    for i in reversed(range(n)):
        x.append(y[i])
        row = [columns[k][i - 1 - k] for k in range(i)]
        if i:
            y = once(y[:i] - jnp.stack(row) * y[i])
    return jnp.stack(x[::-1])


def is_positive_definite(a: np.ndarray) -> bool:
    """Whether a matrix of known numbers is symmetric and positive definite.

    - `a`: matrix [n n].
    """
    return bool(np.allclose(a, a.T, rtol=1e-12, atol=0.0) and np.all(np.linalg.eigvalsh(a) > 0))
