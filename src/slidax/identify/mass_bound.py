"""Relative bounds of a mass matrix for every configuration, from errors of the inertial parameters.

The bound is `-p M₀(q) ≤ ΔM(q) ≤ p M₀(q)` for all q. M₀ is the mass matrix for the inertial parameters φ₀, and ΔM its
change for the parameters' errors Δφ, in which it is linear. The proof needs no grid of configurations. Let V be the
twist of the body that carries joint i, at the joint's origin and in the axes of its frame. I_i is the spatial inertia
of the body that joint i moves, z the joint's axis, and R_i the inertia of its rotor. Twice the arm's kinetic energy is

    q̇ᵀ M q̇ = Σ_i (V + z q̇_i)ᵀ I_i (V + z q̇_i) + R_i q̇_i²                                                     (1)

Choose for each joint a quadratic form L_i on twists that is invariant under the joint's own motion: rotation about its
axis for a revolute joint, displacement along its axis for a prismatic joint. Then `Vᵀ L_i V` is the same in the frames
before and after joint i, for every q_i. Adding it to the body that carries joint i, and subtracting it from the body
that joint i moves, does not change (1). So

    q̇ᵀ M q̇ = Σ_i [V; q̇_i]ᵀ K_i [V; q̇_i],
    K_i = [1 z]ᵀ (I_i + Σ_c X_cᵀ L_c X_c) [1 z] + diag(0, R_i) - diag(L_i, 0)                                  (2)

where c counts the joints that body i carries, and X_c is the constant change of axes to joint c. No K_i depends on q.
If all K_i are positive semidefinite for the parameters `p φ₀ + Δφ` and some L, then `p M₀(q) + ΔM(q) ≥ 0` for every q.
A small semidefinite program gives the smallest such p. K_i is restricted to the twists V that the joints between the
base and joint i can produce, which matters for planar arms.

Any L proves a bound; a better L proves a smaller one. The bounds are exact up to floating-point rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.arms.articulated import PAIRS, Articulated
from slidax.core.errors import DefinitionError

from .regressor import BODY, cross_matrix

GAP = 0.02
"""Largest excess of the bound over the optimum of the semidefinite program, as a share of the optimum."""

NEWTON_STEPS = 4
"""Newton steps per barrier weight."""


@dataclass(frozen=True, eq=False)
class Block:
    """The matrix K_i [m m] of equation (2) in the module's docstring, on a basis of the possible twists.

    It is a sum of constant matrices, each times an inertial parameter φ or a coefficient of a form L.

    - `parameters`: indices in φ of the parameters in K_i [11]: the body's ten, and the rotor.
    - `forms`: indices of the coefficients in K_i among those of all forms L, the coefficients of L_i first [f].
    - `own`: number of coefficients of L_i.
    - `of_parameters`, `of_forms`: constant matrix of each parameter [11 m m] and of each coefficient [f m m].
    """

    parameters: np.ndarray
    forms: np.ndarray
    own: int
    of_parameters: np.ndarray
    of_forms: np.ndarray

    def matrix(self, parameters: np.ndarray, forms: np.ndarray) -> np.ndarray:
        """Return K_i, [... m m].

        - `parameters`: inertial parameters φ of the whole arm [... 11n].
        - `forms`: coefficients of all forms L [... f].
        """
        own = np.tensordot(parameters[..., self.parameters], self.of_parameters, axes=1)
        return own + np.tensordot(forms[..., self.forms], self.of_forms, axes=1)


class MassBound:
    """Relative bounds of the mass matrix's error for errors of the inertial parameters.

    Raises DefinitionError if the mass matrix is not positive definite in this form, as with massless bodies.
    """

    def __init__(self, robot: Articulated, parameters: np.ndarray) -> None:
        """Find the analytic centre L₀ of the forms L that prove `M₀(q) > 0`.

        - `parameters`: φ₀, the arm's inertial parameters as from `arm_parameters` [11n].
        """
        self.blocks, self.coefficients = blocks_of(robot)
        self.centre = self._analytic_centre(parameters)
        self._normalised = []
        for block in self.blocks:
            root = _inverse_root(block.matrix(parameters, self.centre))
            self._normalised.append((root @ block.of_parameters @ root, root @ block.of_forms @ root))

    def of(self, errors: np.ndarray, *, refine: bool = True) -> np.ndarray:
        """Return for each of s parameter errors Δφ a bound p with `-p M₀(q) ≤ ΔM(q) ≤ p M₀(q)` for all q, [s].

        Let L₀ be forms that prove `M₀(q) > 0` with a large margin, and `K_i⁰ = K_i(φ₀, L₀)`. Then the condition
        `K_i(p φ₀ ± Δφ, p L₀ ± L) ≥ 0` is `|E_i| ≤ p` for the normalised `E_i = K_i⁰⁻¹ᐟ² K_i(Δφ, L) K_i⁰⁻¹ᐟ²`. The L
        with the smallest sum of squares of all E_i is linear in Δφ. It gives a bound about 1.4 times the smallest. The
        smallest bound has a different L for each sign, and comes from Newton's method with the barrier -log det.

        - `errors`: Δφ, in the order of `arm_parameters` [s 11n].
        - `refine`: True for nearly the smallest bound; False for the faster bound from least squares.
        """
        forms = self._least_squares(errors)
        both = [self._errors_of(errors, forms), self._errors_of(-errors, -forms)]
        if refine:
            both = [self._refined(matrices) for matrices in both]
        return np.maximum(*(_largest(matrices) for matrices in both))

    def _errors_of(self, errors: np.ndarray, forms: np.ndarray) -> list[np.ndarray]:
        """Return -E_i of each block, [s m m]."""
        return [
            -np.tensordot(errors[:, block.parameters], of_parameters, axes=1)
            - np.tensordot(forms[:, block.forms], of_forms, axes=1)
            for block, (of_parameters, of_forms) in zip(self.blocks, self._normalised, strict=True)
        ]

    def _least_squares(self, errors: np.ndarray) -> np.ndarray:
        sizes = [of_forms.shape[1] ** 2 for _, of_forms in self._normalised]
        ends = np.cumsum([0, *sizes])
        columns, target = np.zeros((ends[-1], self.coefficients)), np.zeros((ends[-1], len(errors)))
        for k, (block, (of_parameters, of_forms)) in enumerate(zip(self.blocks, self._normalised, strict=True)):
            rows = slice(ends[k], ends[k + 1])
            columns[rows, block.forms] = of_forms.reshape(len(of_forms), -1).T
            target[rows] = of_parameters.reshape(len(of_parameters), -1).T @ errors[:, block.parameters].T
        return -np.linalg.lstsq(columns, target, rcond=1e-12)[0].T

    def _refined(self, matrices: list[np.ndarray]) -> list[np.ndarray]:
        """Return the matrices for an L that nearly minimises their largest eigenvalue.

        Minimise p subject to `p - A_i - Σ_k y_k T_ik ≥ 0` by damped Newton steps on `p/μ - Σ log det`. A_i are the
        matrices, y_k the coefficients of L, and T_ik their normalised constant matrices. The function is
        self-concordant, so the steps stay feasible. At its minimum p exceeds the optimum by at most μ times the number
        of rows.
        """
        count = len(matrices[0])
        size = np.maximum(_largest(matrices), 1e-300)
        matrices = [matrix / size[:, None, None] for matrix in matrices]
        rows = sum(matrix.shape[1] for matrix in matrices)
        p, y = np.full(count, 1.2), np.zeros((count, self.coefficients))
        best, least = [matrix.copy() for matrix in matrices], np.ones(count)
        for weight in np.geomspace(0.3 / rows, 0.5 * GAP / rows, 4):
            for _ in range(NEWTON_STEPS):
                p, y = self._newton_step(matrices, p, y, weight)
            now = [
                matrix + np.tensordot(y[:, block.forms], of_forms, axes=1)
                for matrix, block, (_, of_forms) in zip(matrices, self.blocks, self._normalised, strict=True)
            ]
            largest = _largest(now)
            better = largest < least
            least = np.where(better, largest, least)
            best = [np.where(better[:, None, None], a, b) for a, b in zip(now, best, strict=True)]
        return [matrix * size[:, None, None] for matrix in best]

    def _newton_step(
        self, matrices: list[np.ndarray], p: np.ndarray, y: np.ndarray, weight: float
    ) -> tuple[np.ndarray, np.ndarray]:
        count, unknowns = len(p), 1 + self.coefficients
        slope, curve = np.zeros((count, unknowns)), np.zeros((count, unknowns, unknowns))
        slope[:, 0] = 1.0 / weight
        for matrix, block, (_, of_forms) in zip(matrices, self.blocks, self._normalised, strict=True):
            size = matrix.shape[1]
            slack = p[:, None, None] * np.eye(size) - matrix - np.tensordot(y[:, block.forms], of_forms, axes=1)
            own = np.concatenate([np.eye(size)[None], -of_forms])
            product = np.linalg.inv(slack)[:, None] @ own
            where = np.concatenate([[0], 1 + block.forms])
            slope[:, where] -= np.trace(product, axis1=2, axis2=3)
            flat = product.reshape(count, len(own), -1)
            other = np.swapaxes(product, 2, 3).reshape(count, len(own), -1)
            curve[:, where[:, None], where] += flat @ np.swapaxes(other, 1, 2)
        # Scaled to equal curvature; combinations without influence keep their values.
        unit = 1.0 / np.sqrt(np.maximum(np.einsum("sii->si", curve), 1e-200))
        curve = curve * unit[:, :, None] * unit[:, None, :] + 1e-10 * np.eye(unknowns)
        step = -unit * np.linalg.solve(curve, (unit * slope)[:, :, None])[:, :, 0]
        decrement = np.sqrt(np.maximum(-np.sum(slope * step, axis=1), 0.0))
        step /= np.where(decrement > 0.25, 1.0 + decrement, 1.0)[:, None]
        return p + step[:, 0], y + step[:, 1:]

    def _analytic_centre(self, parameters: np.ndarray) -> np.ndarray:
        """Return the L that maximises the product of the determinants of all K_i."""
        forms = self._inside(parameters)
        for _ in range(100):
            slope, curve = np.zeros(self.coefficients), np.zeros((self.coefficients, self.coefficients))
            for block in self.blocks:
                product = np.linalg.inv(block.matrix(parameters, forms)) @ block.of_forms
                slope[block.forms] -= np.trace(product, axis1=1, axis2=2)
                curve[np.ix_(block.forms, block.forms)] += np.einsum("aij,bji->ab", product, product)
            # Scaled to equal curvature in every coefficient.
            unit = 1.0 / np.sqrt(np.maximum(np.diag(curve), 1e-300))
            step = -unit * np.linalg.lstsq(curve * np.outer(unit, unit), unit * slope, rcond=1e-13)[0]
            decrement = np.sqrt(max(float(-slope @ step), 0.0))
            if decrement < 1e-6:
                break
            forms = forms + step / (1.0 + decrement if decrement > 0.25 else 1.0)
        return forms

    def _inside(self, parameters: np.ndarray) -> np.ndarray:
        """Return an L for which all K_i are positive definite."""
        for share in (0.0, *np.geomspace(1e-1, 1e-8, 15)):
            forms = self._definite(parameters, share)
            values = [np.linalg.eigvalsh(block.matrix(parameters, forms)) for block in self.blocks]
            if all(own[0] > 1e-12 * abs(own[-1]) for own in values):
                return forms
        raise DefinitionError("the mass matrix is not bounded: some body of the arm has no mass or no inertia")

    def _definite(self, parameters: np.ndarray, share: float) -> np.ndarray:
        """Return an L that increases each K_i by a share of its size, and lowers K of the body that carries joint i."""
        forms = np.zeros(self.coefficients)
        if share == 0.0:
            return forms
        for block in reversed(self.blocks):
            if not block.own:
                continue
            # The form nearest to a multiple of the identity among those that the joint's motion does not change.
            rows = block.of_forms.shape[1]
            size = float(np.trace(block.matrix(parameters, forms))) / rows
            flat = block.of_forms[: block.own].reshape(block.own, -1)
            target = np.diag([*np.ones(rows - 1), 0.0]).ravel()
            forms[block.forms[: block.own]] = share * size * np.linalg.lstsq(flat.T, target, rcond=1e-12)[0]
        return forms


def blocks_of(robot: Articulated) -> tuple[tuple[Block, ...], int]:
    """Return each joint's matrix K_i of (2) in the module's docstring, and the number of coefficients of all forms L.

    - `robot`: the arm; only its geometry is used.
    """
    n = robot.joints
    rotations, translations = np.asarray(robot.rotations), np.asarray(robot.translations)
    changes = [change_of_axes(rotations[i], translations[i]) for i in range(n)]
    axes = [np.eye(6)[2 if unit == "rad" else 5] for unit in robot.joint_units]
    twists: list[np.ndarray] = []
    invariants: list[np.ndarray] = []
    for i, parent in enumerate(robot.parents):
        before = np.zeros((6, 0)) if parent < 0 else np.column_stack([twists[parent], axes[parent]])
        twists.append(_reachable_twists(changes[i] @ before, robot.joint_units[i]))
        invariants.append(_invariant_forms(twists[i].T @ GENERATORS[robot.joint_units[i]] @ twists[i]))
    ends = np.cumsum([0, *(len(own) for own in invariants)])
    blocks = []
    for i in range(n):
        basis = np.column_stack([twists[i], np.zeros(6)])
        basis[:, -1] = axes[i]
        rotor = np.zeros((1, basis.shape[1], basis.shape[1]))
        rotor[0, -1, -1] = 1.0
        own = np.zeros((len(invariants[i]), *rotor.shape[1:]))
        own[:, :-1, :-1] = -invariants[i]
        forms, of_forms = [np.arange(ends[i], ends[i + 1])], [own]
        for child in range(n):
            if robot.parents[child] == i:
                inward = twists[child].T @ changes[child] @ basis
                forms.append(np.arange(ends[child], ends[child + 1]))
                of_forms.append(inward.T @ invariants[child] @ inward)
        blocks.append(
            Block(
                parameters=np.append(np.arange(i * BODY, (i + 1) * BODY), n * BODY + i),
                forms=np.concatenate(forms),
                own=len(invariants[i]),
                of_parameters=np.concatenate([basis.T @ SPATIAL @ basis, rotor]),
                of_forms=np.concatenate(of_forms),
            )
        )
    return tuple(blocks), int(ends[-1])


def change_of_axes(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Return the matrix from a twist (ω, v) in one frame to the same twist in another, [6 6].

    - `rotation`, `translation`: axes and origin of the new frame in the old one.
    """
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = rotation.T
    change[3:, :3] = -rotation.T @ cross_matrix(translation)
    return change


def _reachable_twists(vectors: np.ndarray, unit: str) -> np.ndarray:
    """Return an orthonormal basis of the given twists and all twists into which a joint's motion turns them, [6 d]."""
    moved = [vectors]
    for position in (0.7, 1.9, 3.1, 4.4, 5.6):
        motion = np.eye(6)
        if unit == "rad":
            c, s = np.cos(position), np.sin(position)
            motion[:3, :3] = motion[3:, 3:] = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        else:
            motion[3:, :3] = -cross_matrix(np.array([0.0, 0.0, position]))
        moved.append(motion @ vectors)
    left, values, _ = np.linalg.svd(np.column_stack(moved), full_matrices=False)
    return left[:, values > 1e-9 * max(values.max(initial=0.0), 1e-300)]


def _invariant_forms(generator: np.ndarray) -> np.ndarray:
    """Return a basis of the symmetric L with `L A + Aᵀ L = 0`, which are invariant under the motion exp(A s), [f d d].

    - `generator`: A, on a basis of the twists [d d].
    """
    size = len(generator)
    rows, columns = np.triu_indices(size)
    forms = np.zeros((len(rows), size, size))
    forms[np.arange(len(rows)), rows, columns] = forms[np.arange(len(rows)), columns, rows] = 1.0
    changes = (forms @ generator + generator.T @ forms).reshape(len(rows), size**2)
    if not changes.size:
        return forms
    left, values, _ = np.linalg.svd(changes)
    values = np.append(values, np.zeros(len(rows) - len(values)))
    return np.tensordot(left[:, values < 1e-9].T, forms, axes=1)


def _inverse_root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors / np.sqrt(values)) @ vectors.T


def _largest(matrices: list[np.ndarray]) -> np.ndarray:
    """Return the largest eigenvalue of all blocks' matrices for each error, [s]."""
    return np.max([np.linalg.eigvalsh(matrix)[:, -1] for matrix in matrices], axis=0)


def _spatial() -> np.ndarray:
    """Return the quadratic form on twists (ω, v) that each of a body's ten parameters multiplies, [10 6 6].

    `m |v|² + 2 v·(ω × h) + ωᵀ I ω`, twice the kinetic energy, with h the mass times the centre of mass and I the
    inertia about the origin.
    """
    forms = np.zeros((BODY, 6, 6))
    forms[0, 3:, 3:] = np.eye(3)
    for axis in range(3):
        cross = cross_matrix(np.eye(3)[axis])
        forms[1 + axis, 3:, :3] = -cross
        forms[1 + axis, :3, 3:] = cross
    for entry, (i, j) in enumerate(PAIRS):
        forms[4 + entry, i, j] = forms[4 + entry, j, i] = 1.0
    return forms


SPATIAL = _spatial()


GENERATORS = {"rad": np.zeros((6, 6)), "m": np.zeros((6, 6))}
"""Change of a twist (ω, v) per unit of motion of a revolute or prismatic joint, in the moving axes."""
GENERATORS["rad"][:3, :3] = GENERATORS["rad"][3:, 3:] = -cross_matrix(np.array([0.0, 0.0, 1.0]))
GENERATORS["m"][3:, :3] = -cross_matrix(np.array([0.0, 0.0, 1.0]))
