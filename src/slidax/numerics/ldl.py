"""Small dense algebra, written out: a library call inside a scanned step would cost five times the whole step."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from slidax._types import Matrix, Vector


def matvec(a: Matrix, x: Vector) -> Vector:
    """`A x` as broadcast and sum.

    - `a`: matrix [n n].
    - `x`: vector [n].
    """
    return jnp.sum(a * x[None, :], axis=1)


def solve_symmetric(a: Matrix, b: Vector) -> Vector:
    """The solution x of `A x = b` by `A = L D Lᵀ` without pivoting, unrolled over the fixed size.

    - `a`: symmetric positive definite matrix [n n]; only the lower triangle is read.
    - `b`: right-hand side [n].
    """
    n = b.shape[0]
    lower: list[list[jnp.ndarray]] = [[] for _ in range(n)]
    diagonal: list[jnp.ndarray] = []
    # The inverses do not wait for b, which in a control loop comes last.
    inverse: list[jnp.ndarray] = []
    for i in range(n):
        for j in range(i):
            known = [lower[i][k] * diagonal[k] * lower[j][k] for k in range(j)]
            lower[i].append(_less(a[i, j], known) * inverse[j])
        diagonal.append(_less(a[i, i], [lower[i][k] * diagonal[k] * lower[i][k] for k in range(i)]))
        inverse.append(1.0 / diagonal[i])
    y: list[jnp.ndarray] = []
    for i in range(n):
        y.append(_less(b[i], [lower[i][k] * y[k] for k in range(i)]))
    x: list[jnp.ndarray] = [jnp.zeros_like(b[0])] * n
    for i in reversed(range(n)):
        x[i] = _less(y[i] * inverse[i], [lower[k][i] * x[k] for k in range(i + 1, n)])
    return jnp.stack(x)


def _less(start: jnp.ndarray, terms: list[jnp.ndarray]) -> jnp.ndarray:
    for term in terms:
        start = start - term
    return start


def is_positive_definite(a: np.ndarray) -> bool:
    """Whether a matrix of known numbers is symmetric and positive definite.

    - `a`: matrix [n n].
    """
    return bool(np.allclose(a, a.T, rtol=1e-12, atol=0.0) and np.all(np.linalg.eigvalsh(a) > 0))
