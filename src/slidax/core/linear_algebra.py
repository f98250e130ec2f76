"""Linear algebra for small symmetric matrices, without library calls."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .powers import vector_norm
from .tracing import barrier
from .types import Matrix, Scalar, Vector


@jax.jit
def matvec(a: Matrix, x: Vector) -> Vector:
    """`A x` by broadcasting and summation.

    - `a`: matrix [n n].
    - `x`: vector [n].
    """
    return jnp.sum(a * x[None, :], axis=1)


def solve_symmetric(a: Matrix, b: Vector) -> Vector:
    """The solution x of `A x = b` by `A = L D Lᵀ` without pivoting, unrolled over the fixed size.

    A and b are eliminated column by column, with array operations. These are few operations to trace and compile, and
    those for a column depend only on the previous column.

    - `a`: symmetric positive definite matrix [n n]; only the lower triangle is read.
    - `b`: right-hand side [n].
    """
    return _substituted(*_factors(a), b)


# The cache of jit avoids tracing these two again, and exported C has a function for each.
@jax.jit
def _factors(a: Matrix) -> tuple[Matrix, Vector]:
    """The rows of Lᵀ without the ones on its diagonal, and the inverses of the entries of D."""
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
        a = barrier(jax.lax.slice(a, (1, 1), (size, size)) - (column * pivot) * row)
    upper, inverse = barrier((jnp.concatenate(rows), jnp.concatenate(inverses)))
    return upper, inverse


@jax.jit
def _substituted(upper: Matrix, inverses: Vector, b: Vector) -> Vector:
    """The solution of `L D Lᵀ x = b`."""
    n = b.shape[0]
    y: list[jnp.ndarray] = []
    for i in range(n):
        top = jax.lax.slice_in_dim(b, 0, 1)
        y.append(top * inverses[i])
        b = barrier(jax.lax.slice_in_dim(b, 1, n - i) - jax.lax.slice(upper, (i, i + 1), (i + 1, n))[0] * top)
    left = barrier(jnp.concatenate(y))
    x: list[jnp.ndarray] = []
    for i in reversed(range(n)):
        x.append(jax.lax.slice_in_dim(left, i, i + 1))
        left = barrier(jax.lax.slice_in_dim(left, 0, i) - jax.lax.slice(upper, (0, i), (i, i + 1))[:, 0] * x[-1])
    return jnp.concatenate(x[::-1])


def is_positive_definite(a: np.ndarray) -> bool:
    """True if a matrix of known numbers is symmetric and positive definite.

    - `a`: matrix [n n].
    """
    return bool(np.allclose(a, a.T, rtol=1e-12, atol=0.0) and np.all(np.linalg.eigvalsh(a) > 0))


SQUARINGS = 10
"""Number of repeated squarings in `inverse_norm`: its exponent is m = 2¹⁰."""


def inverse_norm(a: Matrix) -> Scalar:
    """Spectral norm `‖A⁻¹‖ = 1/λmin(A)`, with finite gradients also for repeated eigenvalues.

    A closed form for up to three rows. Its relative error is the rounding error times λmax/λmin, and for three rows
    3e-8 λmax/λmin if the two smallest eigenvalues are equal. From four rows on it is `(tr A⁻ᵐ)^(1/m)` with m = 1024 by
    repeated squaring. This is never less than the norm and exceeds it by at most the factor `n^(1/m)`: by 0.2 % for
    seven equal eigenvalues, and negligibly if the smallest is 3 % below the others.

    - `a`: symmetric positive definite matrix [n n].
    """
    n = a.shape[0]
    if n == 1:
        return 1.0 / a[0, 0]
    if n == 2:
        return _inverse_norm_two_rows(a)
    if n == 3:
        return 1.0 / _smallest_eigenvalue_three_rows(a)
    return _inverse_norm_by_squaring(a)


def _inverse_norm_two_rows(a: Matrix) -> Scalar:
    """`λmax/det A`: computing λmin itself would lose digits by cancellation."""
    half = 0.5 * (a[0, 0] - a[1, 1])
    largest = 0.5 * (a[0, 0] + a[1, 1]) + vector_norm(jnp.stack([half, a[1, 0]]))
    return largest / (a[0, 0] * a[1, 1] - a[1, 0] * a[1, 0])


def _smallest_eigenvalue_three_rows(a: Matrix) -> Scalar:
    """Smallest eigenvalue by the trigonometric formula (O. K. Smith, 1961)."""
    mean = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    x, y, z = a[0, 0] - mean, a[1, 1] - mean, a[2, 2] - mean
    u, v, w = a[1, 0], a[2, 0], a[2, 1]
    p = vector_norm(jnp.stack([x, y, z, u, u, v, v, w, w])) / np.sqrt(6.0)
    safe = jnp.where(p > 0, p, 1.0)
    determinant = x * (y * z - w * w) - u * (u * z - v * w) + v * (u * w - v * y)
    # At ±1, where two eigenvalues are equal, the slope of the arc cosine is infinite.
    cosine = jnp.clip(determinant / (2.0 * safe * safe * safe), -1.0 + 1e-14, 1.0 - 1e-14)
    return mean + 2.0 * p * jnp.cos(jnp.arccos(cosine) / 3.0 + 2.0 * np.pi / 3.0)


def _inverse_norm_by_squaring(a: Matrix) -> Scalar:
    columns: Matrix = jax.vmap(solve_symmetric, in_axes=(None, 0))(a, jnp.eye(a.shape[0]))
    trace = jnp.trace(columns)
    product, logarithm, share = columns / trace, jnp.log(trace), 1.0
    for _ in range(SQUARINGS):
        product = jnp.sum(product[:, :, None] * product[None, :, :], axis=1)
        trace, share = jnp.trace(product), 0.5 * share
        product, logarithm = product / trace, logarithm + share * jnp.log(trace)
    return jnp.exp(logarithm)


SWEEPS = 30
"""Number of coordinate-descent sweeps over the joints. For arms each sweep at least halves the remaining distance."""


def nearest_in_box(wanted: Vector, lower: Vector, upper: Vector, mass: Matrix) -> Vector:
    """The x in the box that minimises `(x - wanted)ᵀ M⁻¹ (x - wanted)`, [n].

    Of all torques within their limits, these give the accelerations nearest to the wanted ones, weighted by the inertia
    (Gauss's principle of least constraint, 1829). A joint below its torque limit gets its wanted acceleration even if
    another joint saturates. Clipping each torque separately would disturb the coupled joints.

    - `wanted`: wanted torques [n], N m or N.
    - `lower`, `upper`: bounds of x, the box [n]; may be infinite.
    - `mass`: M, the inertia matrix, symmetric positive definite [n n].
    """

    def project() -> Vector:
        n = wanted.shape[0]
        inverse: Matrix = jax.vmap(solve_symmetric, in_axes=(None, 0))(mass, jnp.eye(n))
        least, most = lower - wanted, upper - wanted

        def sweep(_: Int[Array, ""], x: Vector) -> Vector:
            for i in range(n):
                pull = jnp.sum(inverse[i] * x) - inverse[i, i] * x[i]
                x = x.at[i].set(jnp.clip(-pull / inverse[i, i], least[i], most[i]))
            return x

        start = jnp.clip(jnp.zeros_like(wanted), least, most)
        # Rounding of the sum may leave the box.
        return jnp.clip(wanted + jax.lax.fori_loop(0, SWEEPS, sweep, start), lower, upper)

    inside = jnp.all((wanted >= lower) & (wanted <= upper))
    return jax.lax.cond(inside, lambda: wanted, project)
