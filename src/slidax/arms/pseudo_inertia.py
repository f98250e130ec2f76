"""The pseudo-inertia of a rigid body: a body can exist if and only if this matrix is positive semi-definite."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

SWEEPS = 6
"""Jacobi sweeps; a symmetric 4 x 4 matrix is diagonal to rounding after five."""

Body = Float[Array, "10"]
"""Mass [kg], mass times centre (x, y, z) [kg m], inertia about the origin (xx, yy, zz, xy, xz, yz) [kg m²]."""


def pseudo_inertia(body: Body) -> Float[Array, "4 4"]:
    """Return a body's pseudo-inertia `[[tr(I)/2 1 - I, h], [hᵀ, m]]` (Wensing, Kim and Slotine, RA-L 2018).

    m is the mass, h the mass times centre, and I the inertia about the origin.
    """
    m, (x, y, z), (xx, yy, zz, xy, xz, yz) = body[0], body[1:4], body[4:]
    half = 0.5 * (xx + yy + zz)
    entries = [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]
    return jnp.stack([jnp.stack(row) for row in entries])


def body_of(matrix: Float[Array, "4 4"]) -> Body:
    """Return the 10 parameters of the body that has this pseudo-inertia."""
    trace = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
    moments = [trace - matrix[i, i] for i in range(3)]
    products = [-matrix[0, 1], -matrix[0, 2], -matrix[1, 2]]
    return jnp.stack([matrix[3, 3], matrix[0, 3], matrix[1, 3], matrix[2, 3], *moments, *products])


def nearest_body(body: Body, least: float) -> Body:
    """Return the body nearest to `body` whose pseudo-inertia has no eigenvalue below `least`.

    The distance is the Frobenius norm of the change of the pseudo-inertia.
    """
    values, vectors = eigen(pseudo_inertia(body))
    kept = jnp.maximum(values, least)
    return body_of(jnp.sum(vectors[:, None, :] * vectors[None, :, :] * kept, axis=2))


def least_eigenvalue(body: Body) -> tuple[Float[Array, ""], Body]:
    """Return the least eigenvalue of a body's pseudo-inertia, and its derivative by the 10 parameters [10]."""
    values, vectors = eigen(pseudo_inertia(body))
    at = jnp.argmin(values)
    x, y, z, w = vectors[:, at]
    half = 0.5 * (x * x + y * y + z * z)
    moments = [half - x * x, half - y * y, half - z * z, -2.0 * x * y, -2.0 * x * z, -2.0 * y * z]
    return values[at], jnp.stack([w * w, 2.0 * x * w, 2.0 * y * w, 2.0 * z * w, *moments])


# With jit, it is traced once and becomes a function in exported C.
@jax.jit
def eigen(matrix: Float[Array, "4 4"]) -> tuple[Float[Array, "4"], Float[Array, "4 4"]]:
    """Return eigenvalues and eigenvectors, as columns, of a symmetric matrix by cyclic Jacobi rotations.

    Source: Golub and Van Loan, Matrix Computations, 2013, section 8.5. No library call, so that it runs in exported C.
    """

    def sweep(_: Int[Array, ""], both: tuple[Array, Array]) -> tuple[Array, Array]:
        for first in range(matrix.shape[0]):
            for second in range(first + 1, matrix.shape[0]):
                both = _rotated(*both, first, second)
        return both

    diagonal, vectors = jax.lax.fori_loop(0, SWEEPS, sweep, (matrix, jnp.eye(matrix.shape[0])))
    return jnp.diagonal(diagonal), vectors


def _rotated(a: Array, vectors: Array, first: int, second: int) -> tuple[Array, Array]:
    """Return `a` and `vectors` after the Jacobi rotation that makes `a[first, second]` zero."""
    off, gap = a[first, second], a[second, second] - a[first, first]
    size = jnp.abs(gap) + jnp.sqrt(gap * gap + 4.0 * off * off)
    tangent = jnp.where(gap >= 0, 2.0, -2.0) * off / jnp.where(size > 0, size, 1.0)
    cosine = 1.0 / jnp.sqrt(1.0 + tangent * tangent)
    turn = cosine, tangent * cosine
    a = _turned(_turned(a, first, second, turn).T, first, second, turn).T
    return a, _turned(vectors, first, second, turn)


def _turned(a: Array, first: int, second: int, turn: tuple[Array, Array]) -> Array:
    cosine, sine = turn
    x, y = a[:, first], a[:, second]
    return a.at[:, first].set(cosine * x - sine * y).at[:, second].set(sine * x + cosine * y)
