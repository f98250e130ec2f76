"""Changes of inertial parameters that keep an arm in a band around the nominal one, for random draws."""

from __future__ import annotations

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.mismatch import INERTIAL
from slidax.core.errors import DefinitionError
from slidax.identify.band import arm_parameters
from slidax.identify.mass_bound import MassBound
from slidax.identify.regression import BASIS, pseudo_inertia
from slidax.identify.regressor import BODY

from .uncertain_values import Array


def changes_of_bodies(shares: Array, arm: Articulated, p: float) -> Array:
    """Return changes of the inertial parameters in a band of relative half width p.

    The result has the axes [rows, 11, n]: for each joint ten parameters of its body, then its rotor inertia. A body's
    pseudo-inertia J0 changes by `√J0 p S √J0ᵀ`, with a symmetric S of norm 1 at most. A rotor inertia changes by a
    share of p at most.

    - `shares`: numbers in [-1, 1], ten for each body and then one for each rotor [rows, 11n].
    - `arm`: the nominal arm.
    """
    phi, n = arm_parameters(arm), arm.joints
    changes = np.empty_like(shares)
    for i in range(n):
        own = slice(i * BODY, (i + 1) * BODY)
        sizes = np.tensordot(shares[:, own], SYMMETRIC, axes=1)
        sizes /= np.maximum(np.linalg.norm(sizes, 2, axis=(1, 2)), 1.0)[:, None, None]
        values, axes = np.linalg.eigh(pseudo_inertia(phi[own]))
        root = axes * np.sqrt(np.maximum(values, 0.0))
        flat = (p * root @ sizes @ root.T).reshape(len(shares), -1)
        changes[:, own] = np.linalg.lstsq(BASIS.reshape(BODY, -1).T, flat.T, rcond=None)[0].T
    changes[:, BODY * n :] = p * shares[:, BODY * n :] * phi[BODY * n :]
    return _by_joint(changes, n)


def changes_in_ellipsoid(xi: Array, deviations: Array, arm: Articulated, p: float) -> Array:
    """Return changes ξ D of an identified arm's inertial parameters, within its confidence ellipsoid.

    A change is scaled down if the mass matrix would change by more than the relative share p. The result has the axes
    [rows, 11, n]: for each joint ten parameters of its body, then its rotor inertia.

    - `xi`: ξ, of norm 1 at most [rows, r].
    - `deviations`: D, as `slidax identify` writes it [r, 11n]: ten columns for each body, then one for each rotor.
    - `arm`: the identified arm.
    - `p`: largest relative change of the mass matrix.

    Raises DefinitionError if D does not fit the arm.
    """
    n = arm.joints
    if deviations.ndim != 2 or deviations.shape[1] != INERTIAL * n:
        raise DefinitionError(
            f"`deviations` must have rows of {INERTIAL * n} numbers for {n} joints; got shape {list(deviations.shape)}"
        )
    changes = xi @ deviations
    size = MassBound(arm, arm_parameters(arm)).of(changes, refine=False)
    return _by_joint(changes * np.minimum(1.0, p / np.maximum(size, 1e-300))[:, None], n)


def _by_joint(changes: Array, n: int) -> Array:
    bodies = changes[:, : BODY * n].reshape(-1, n, BODY).swapaxes(1, 2)
    return np.concatenate([bodies, changes[:, None, BODY * n :]], axis=1)


def _symmetric() -> Array:
    forms = np.zeros((BODY, 4, 4))
    for k, (i, j) in enumerate(zip(*np.triu_indices(4), strict=True)):
        forms[k, i, j] = forms[k, j, i] = 1.0
    return forms


SYMMETRIC = _symmetric()
"""A basis of the symmetric matrices [10 4 4]."""
