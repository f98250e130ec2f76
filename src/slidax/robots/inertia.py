"""Inertias that rigid bodies can have, and the nearest of them to an impossible one."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError, Setting

ROUNDING = 1e-6
"""By this share a printed inertia may miss what a rigid body can have: it is rounded."""

ZERO = 1e-9
"""Below this share of the largest a negative principal moment is a rounded 0."""

POINT = 1e-15
"""kg m²: moments below this are rounded zeros, as of a point. A grain of 1 mg and 0.1 mm has ten times as much."""


def require_rigid(inertia: np.ndarray, what: str, *, moves: bool, setting: Setting | None = None) -> None:
    """Raise DefinitionError unless a rigid body can have this inertia.

    A principal moment may be 0, as of a thin rod, or negative within rounding relative to the largest.

    - `inertia`: about the centre of mass, symmetric [3 3], kg m².
    - `what`: name of the inertia, for the message.
    - `moves`: True if a joint moves the body; then an inertia of 0 is rejected, as it is mostly a forgotten one.
    - `setting`: the setting that selects the nearest possible inertia, for the message.
    """
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.3g}" for moment in moments)
    end = f"; {setting.in_python} takes the nearest that a body can have" if setting else ""
    if moves and is_point(inertia):
        raise DefinitionError(
            f"{what} must be positive definite; its principal moments are {listed} kg m²; write the body's own there"
        )
    if is_rigid(inertia):
        return
    if moments[0] < -ZERO * abs(moments[2]):
        rule = "positive definite" if moves else "positive semi-definite"
        raise DefinitionError(f"{what} must be {rule}; its principal moments are {listed} kg m²{end}").offering(setting)
    raise DefinitionError(
        f"{what} is of no rigid body: the largest of its principal moments {listed} kg m² is more than the sum of the "
        f"others{end}"
    ).offering(setting)


def is_point(inertia: np.ndarray) -> bool:
    """True if an inertia [3 3] is 0 within rounding."""
    return bool(np.linalg.norm(inertia, 2) < POINT)


def is_rigid(inertia: np.ndarray) -> bool:
    """True if, within rounding, no principal moment is negative or greater than the sum of the others."""
    if is_point(inertia):
        return True
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] >= -ZERO * abs(moments[2]) and moments[0] + moments[1] >= moments[2] * (1.0 - ROUNDING))


def nearest_rigid(inertia: np.ndarray) -> np.ndarray:
    """Return the nearest inertia [3 3] that a rigid body can have, kg m².

    A body of mass density ρ has the second moments `Σ = ∫ρ x xᵀ dV`, which are positive semi-definite, and `I = tr(Σ) 1
    - Σ`, so `Σ = ½ tr(I) 1 - I`. Each positive semi-definite Σ belongs to some body. The nearest Σ in the Frobenius
    norm is the projection on these matrices: its negative eigenvalues become 0 (Higham, *Computing a nearest symmetric
    positive semidefinite matrix*, 1988). The axes stay. With unchanged mass and centre of mass this is also the
    projection of the pseudo-inertia `[Σ 0; 0 m]` (Wensing, Kim and Slotine, *Linear matrix inequalities for physically
    consistent inertial parameter identification*, RA-L 2018).
    """
    moments, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    kept = np.maximum(moments, 0.0)
    return (axes * (kept.sum() - kept)) @ axes.T
