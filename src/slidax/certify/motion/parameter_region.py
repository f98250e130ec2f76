"""Regions of inertial parameters around the nominal arm, as a bound along a motion needs them.

M and M0 are the true and the nominal inertia matrix. Three statements on the error of the parameters hold at once:

1. the band: `(1 - p) M0(q) <= M(q) <= (1 + p) M0(q)` for every q;
2. the cover: `-C_b <= ΔJ_b <= C_b` for the pseudo-inertia of each body b, and a bound of |ΔR_i| for each rotor;
3. the ellipsoid, if there is one: the error is `ξ D` for a matrix D and a row ξ with |ξ| <= 1.

The ellipsoid gives exact bounds of torques at one state. The cover is less tight, and bounds the small remainders of
Taylor's theorem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.identify.band import Band, base_parameters
from slidax.identify.regressor import BODY

from .body_points import BodyPoints, points_of, pseudo_inertias

Floats = NDArray[np.float64]

SHARE = 0.3
"""Share of the mean body that is added to each body's pseudo-inertia before it scales the cover (T of `cover_points`).

With it, the metric of a light body is not singular."""


@dataclass(frozen=True, eq=False)
class ParameterRegion:
    """Region of the true arm's inertial parameters around the nominal ones; all three bounds hold at once.

    - `p`: the band: `(1 - p) M0(q) <= M(q) <= (1 + p) M0(q)` for the nominal and the true inertia matrix.
    - `points`: the cover: four points of each C_b, with `-C_b <= ΔJ_b <= C_b` for the error of body b's pseudo-inertia
      [n 4 4]; `rotors`: largest errors of the rotors' inertias [n], kg m².
    - `deviations`, `rotor_deviations`: the ellipsoid: the error of all parameters is `ξ D` with |ξ| <= 1. These are the
      pseudo-inertias [r n 4 4] and rotor inertias [r n] of the rows of D; without an ellipsoid r is 0.
    - `title`: the region in words.
    """

    p: float
    points: Floats
    rotors: Floats
    deviations: Floats
    rotor_deviations: Floats
    title: str

    @property
    def has_ellipsoid(self) -> bool:
        """True if the region has an ellipsoid."""
        return len(self.deviations) > 0


@dataclass(frozen=True)
class BodyBand:
    """Band of inertial parameters around the nominal arm.

    - `bodies`: p with `(1 - p) J0 <= J <= (1 + p) J0` for the true and the nominal pseudo-inertia J and J0 of every
      link, payload included.
    - `rotors`: p of the rotors' inertias, in the same inequalities.

    Raises DefinitionError unless both are in [0, 1).
    """

    bodies: float
    rotors: float

    def __post_init__(self) -> None:
        for name in ("bodies", "rotors"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise DefinitionError(f"`BodyBand.{name}` must be in [0, 1); got {value:g}")

    def region(self, bodies: BodyPoints) -> ParameterRegion:
        """Return the region around the nominal arm with these bodies.

        Its p is the larger of both, as M is a positive linear map of inertias and rotors.
        """
        n = bodies.joints
        return ParameterRegion(
            p=max(self.bodies, self.rotors),
            points=np.sqrt(self.bodies) * bodies.points,
            rotors=self.rotors * bodies.rotors,
            deviations=np.zeros((0, n, 4, 4)),
            rotor_deviations=np.zeros((0, n)),
            title=f"{100 * self.bodies:g} % of the nominal pseudo-inertias and {100 * self.rotors:g} % of the rotors",
        )


def identified_region(arm: Articulated, band: Band) -> ParameterRegion:
    """Return the region of an identified arm.

    Combinations of parameters that affect no torque are free. They are chosen by least squares, so that the errors are
    small relative to the bodies' parameters. So the cover, which has a bound for each body, is small.

    - `arm`: the identified arm, which is the nominal arm. `band`: p and the ellipsoid of its parameters' errors.

    Raises DefinitionError if the band has another number of joints, or p is not below 1.
    """
    n = arm.joints
    if band.deviations.shape[1] != (BODY + 1) * n:
        raise DefinitionError(
            f"`band.deviations` must have {(BODY + 1) * n} columns for {n} joints; got {band.deviations.shape[1]}"
        )
    if not band.p < 1.0:
        raise DefinitionError(
            f"the band's p must be below 1 for a bound along a motion; got {band.p:.3g}; identify from a longer log"
        )
    bodies = BodyPoints.of(arm)
    mean = np.diagonal(bodies.pseudo_inertias.mean(axis=0))
    spread = float(np.mean(mean[:3]))
    roots = _inverse_root(bodies.pseudo_inertias + SHARE * np.diag([spread, spread, spread, mean[3]]))
    rotors = bodies.rotors + SHARE * (bodies.rotors.mean() + spread)
    deviations = _least_deviations(arm, band.deviations, roots, rotors)
    pseudo = pseudo_inertias(deviations[:, : BODY * n])
    return ParameterRegion(
        p=band.p,
        points=cover_points(pseudo, roots),
        rotors=np.linalg.norm(deviations[:, BODY * n :], axis=0),
        deviations=pseudo,
        rotor_deviations=deviations[:, BODY * n :],
        title=f"the band of the identified arm, p = {100 * band.p:.2g} % ({100 * band.confidence:g} % confidence)",
    )


def ball_region(arm: Articulated, rows: Floats, p: float, title: str) -> ParameterRegion:
    """Return the region of parameter errors `ξ D` with |ξ| <= 1.

    - `arm`: the nominal arm. `rows`: D [r 11n], ten parameters per body, then the rotors. `title`: the region in words.
    - `p`: bound of the inertia matrix's relative error, as in `ParameterRegion`.

    Raises DefinitionError as `identified_region` does.
    """
    require_small(p)
    empty = np.zeros((2, 0))
    return replace(identified_region(arm, Band(1.0, p, empty, empty, empty, rows, True)), title=title)


def require_small(p: float) -> None:
    """Raise DefinitionError unless p is below 1.

    - `p`: bound of the inertia matrix's relative error, as in `ParameterRegion`.
    """
    if not p < 1.0:
        raise DefinitionError(
            f"the true mass matrix may differ from the nominal one M0 by p M0, with p = {p:.3g}; a bound along a "
            "motion needs p < 1: make the uncertainty sets narrower, or identify the arm"
        )


def joined_regions(regions: Sequence[ParameterRegion]) -> ParameterRegion:
    """Return the region that contains every sum of parameter errors, one from each region.

    p and the covers add up. With weights `w_k > 0` whose sum is 1, a sum of errors from ellipsoids D_k lies in the
    ellipsoid of the rows `D_k/√w_k`. The weights are in proportion to p.

    Raises DefinitionError if p is not below 1.
    """
    regions = [region for region in regions if region.p > 0.0] or list(regions[:1])
    p = sum(region.p for region in regions)
    require_small(p)
    sizes = f"all together p = {100 * p:.2g} % of the mass matrix"
    if len(regions) == 1:
        only = regions[0]
        return only if "%" in only.title else replace(only, title=f"{only.title}, {sizes}")
    whole = all(region.has_ellipsoid for region in regions)
    widened = [np.sqrt(p / region.p) for region in regions]
    first = regions[0]
    return ParameterRegion(
        p=p,
        points=points_of(sum((np.swapaxes(each.points, 1, 2) @ each.points for each in regions), np.zeros(()))),
        rotors=np.sum([region.rotors for region in regions], axis=0),
        deviations=np.concatenate([f * each.deviations for f, each in zip(widened, regions, strict=True)])
        if whole
        else first.deviations[:0],
        rotor_deviations=np.concatenate([f * each.rotor_deviations for f, each in zip(widened, regions, strict=True)])
        if whole
        else first.rotor_deviations[:0],
        title=f"{' and '.join(each.title for each in regions)}, {sizes}",
    )


def cover_points(deviations: Floats, roots: Floats) -> Floats:
    """Return points of C with `-C <= Σ_r ξ_r J_r <= C` for all |ξ| <= 1, for each body, [n 4 4].

    With `S_r = T J_r T`, `(Σ ξ_r S_r)² <= Σ S_r²` by Cauchy's inequality. The root of matrices is monotone, so that
    `C = T⁻¹ (Σ S_r²)^½ T⁻¹`.

    - `deviations`: J_r [r n 4 4].
    - `roots`: T [n 4 4], symmetric and positive definite.
    """
    scaled = roots @ deviations @ roots
    values, vectors = np.linalg.eigh(np.sum(scaled @ scaled, axis=0))
    size = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ vectors.swapaxes(1, 2)
    inverse = np.linalg.inv(roots)
    return points_of(inverse @ size @ inverse)


def _least_deviations(arm: Articulated, deviations: Floats, roots: Floats, rotors: Floats) -> Floats:
    """Return parameter errors [r 11n] with the same effect on torques as `deviations`, and of least size.

    - `deviations`: parameter errors [r 11n].
    - `roots`, `rotors`: metric of the size: a 4 × 4 matrix that scales each pseudo-inertia, and a unit of each rotor.
    """
    n = arm.joints
    base, scale = base_parameters(arm)
    hidden = np.linalg.svd(base.T)[2][base.shape[1] :] * scale

    def sized(parameters: Floats) -> Floats:
        bodies = roots @ pseudo_inertias(parameters[:, : BODY * n]) @ roots
        return np.concatenate([bodies.reshape(len(parameters), -1), parameters[:, BODY * n :] / rotors], axis=1)

    share, *_ = np.linalg.lstsq(sized(hidden).T, -sized(deviations).T, rcond=None)
    return np.asarray(deviations + share.T @ hidden)


def _inverse_root(matrices: Floats) -> Floats:
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors / np.sqrt(values)[..., None, :]) @ vectors.swapaxes(-1, -2))
