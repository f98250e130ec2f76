"""Certified bound of the tracking error along a motion, for every arm in a set of inertial parameters.

`certified_law.py` derives the inputs from a scenario, and has the bound of the encoders' noise (`SIGMAS`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.core.joint_names import joint_label
from slidax.identify.band import Band
from slidax.motions.trajectory import AbstractMotion

from ..certificate import Assumption, Verdict, joint_values
from .body_points import BodyPoints
from .fixed_point import Bounds, Inputs, memory
from .hand_over import HandOver
from .joint_loop import JointLoop
from .parameter_region import BodyBand, ParameterRegion, identified_region
from .path import Path
from .path_cells import PathCells
from .tube_search import Solution, bounds_along

Floats = NDArray[np.float64]

NAME = "tracking_bound"
TITLE = "tracking error along the motion"

WIDEST = 0.05
"""rad or m: the search for an error bound stops above this value."""

FINER = 4
"""If no bound exists with the default cells, the search is repeated with cells shorter by this factor."""


@dataclass(frozen=True, eq=False)
class ArmUncertainty:
    """Uncertainty of the true arm, its sensors and its surroundings. Each value is a scalar or one value per joint.

    - `band`: band of the inertial parameters and the rotors; `identified` takes it from an identification.
    - `coulomb`: largest Coulomb friction that is not compensated, N m or N. With a feed-forward of Coulomb friction,
      give the largest friction plus the feed-forward: near a reversal the feed-forward may have the wrong sign.
    - `viscous_error`: largest error of the viscous friction that the law feeds forward, N m s/rad or N s/m.
    - `torque`: largest disturbance torque of any form, N m or N.
    - `torque_rate`: largest rate of the disturbance torque, N m/s or N/s; None if the rate has no bound.
    - `resolution`: resolution of the encoders plus the range of their noise, peak to peak, rad or m. The error of a
      measured position is at most half of this value.
    - `start_error`, `start_speed`: largest |e|, rad or m, and |ė|, rad/s or m/s, when the motion starts.
    - `settled`: True if the law has held the arm at rest before; False if its disturbance estimate starts from 0.

    Raises DefinitionError for a value below 0.
    """

    band: BodyBand | ParameterRegion
    coulomb: Any = 0.0
    viscous_error: Any = 0.0
    torque: Any = 0.0
    torque_rate: Any = None
    resolution: Any = 0.0
    start_error: Any = 0.0
    start_speed: Any = 0.0
    settled: bool = False

    def __post_init__(self) -> None:
        for name in ("coulomb", "viscous_error", "torque", "torque_rate", "resolution", "start_error", "start_speed"):
            value = getattr(self, name)
            if value is not None and not np.all(np.asarray(value, float) >= 0.0):
                raise DefinitionError(f"`ArmUncertainty.{name}` must be >= 0; got {value}")

    @classmethod
    def identified(cls, arm: Articulated, band: Band, **others: Any) -> ArmUncertainty:
        """Return the uncertainty of an identified arm: its band, and the intervals of its friction.

        The band's ellipsoid includes the rotors. If the band has no friction intervals, give `coulomb` and
        `viscous_error`.

        - `arm`: the identified arm, which is the nominal arm; `band`: its band, as `Identification.band`.
        - `others`: further fields, such as `resolution`. A `coulomb` or `viscous_error` here replaces the interval.

        Raises DefinitionError as `identified_region` does.
        """
        friction: dict[str, Any] = {}
        if band.coulomb.size:
            friction["coulomb"] = band.coulomb[1]
        if band.viscous.size:
            friction["viscous_error"] = np.max(np.abs(band.viscous - np.asarray(arm.viscous)), axis=0)
        return cls(identified_region(arm, band), **{**friction, **others})

    def region(self, bodies: BodyPoints) -> ParameterRegion:
        """Return the region of the true arm's inertial parameters, from `band`.

        - `bodies`: bodies of the nominal arm.
        """
        return self.band.region(bodies) if isinstance(self.band, BodyBand) else self.band

    def inputs(self, arm: Articulated) -> Inputs:
        """Return the bounds as arrays with one value per joint; `band` is left out.

        - `arm`: the nominal arm. Its viscous friction plus `viscous_error` is the largest viscous coefficient.

        Raises DefinitionError if a list does not have one value per joint.
        """

        def joints(name: str) -> Floats:
            value = getattr(self, name)
            value = np.asarray(np.inf if value is None else value, float)
            if value.shape not in ((), (arm.joints,)):
                raise DefinitionError(
                    f"`ArmUncertainty.{name}` must be one number or {arm.joints} numbers (one per joint); got "
                    f"{value.size}"
                )
            return np.broadcast_to(value, (arm.joints,))

        return Inputs(
            coulomb=joints("coulomb"),
            viscous=np.asarray(arm.viscous, float) + joints("viscous_error"),
            viscous_error=joints("viscous_error"),
            torque=joints("torque"),
            torque_rate=joints("torque_rate"),
            resolution=joints("resolution"),
            start_error=joints("start_error"),
            start_speed=joints("start_speed"),
            settled=self.settled,
        )


@dataclass(frozen=True, eq=False)
class CertifiedPath:
    """The bounds along a motion, and the loop, path and uncertainty that they were computed from."""

    loop: JointLoop
    path: Path = field(repr=False)
    uncertainty: ArmUncertainty
    inputs: Inputs
    solution: Solution = field(repr=False)

    @property
    def bounds(self) -> Bounds:
        """The bounds in each cell."""
        return self.solution.bounds


def certified_path(
    arm: Articulated,
    motion: AbstractMotion,
    loop: JointLoop,
    uncertainty: ArmUncertainty,
    *,
    bodies: BodyPoints | None = None,
    hand_over: HandOver | None = None,
    until: float | None = None,
) -> CertifiedPath:
    """Compute the error bounds along a motion.

    - `arm`: the law's nominal arm, with its payload.
    - `motion`: a piecewise polynomial that ends at rest, or a smooth motion.
    - `loop`: the linear control loop, the same in every joint. `uncertainty`: bounds of the true arm and its sensors.
    - `bodies`: bodies of the arm, if already computed.
    - `hand_over`: the plan of a law with a sliding surface; None for computed torque.
    - `until`: end of the bounded time, for a motion without an end [s].

    Raises DefinitionError if an argument is invalid, the loop is unstable for an arm of the band, or the arm's inertia
    changes too fast along the motion.
    """
    inputs = uncertainty.inputs(arm)
    bodies = bodies or BodyPoints.of(arm)
    region = uncertainty.region(bodies)
    rest = 2.0 * memory(loop)
    cells = PathCells.of(motion, loop.period, rest=rest, until=until)
    if uncertainty.settled and np.any(cells.pieces.at(np.zeros(1))[1]):
        raise DefinitionError(
            "`ArmUncertainty.settled` needs a motion that starts at rest, and this one moves at 0 s: set it to False"
        )
    for finer in (1, FINER):
        if finer > 1:
            cells = PathCells.of(motion, loop.period, per_cell=max(1, cells.per_cell // finer), rest=rest, until=until)
        path = Path.of(bodies, region, cells)
        along = None if hand_over is None else hand_over.along(cells)
        solution = bounds_along(loop, path, inputs, cap=WIDEST, hand_over=along)
        if solution is not None and (solution.bounds.verified or _largest_term(solution.bounds) == "hand-over"):
            break
    if solution is None:
        raise DefinitionError(
            f"the arm's inertia changes too fast along the motion: by more than half within {2e3 * cells.half:.3g} ms, "
            "or faster than the loop settles; slow the motion down"
        )
    return CertifiedPath(loop, path, uncertainty, inputs, solution)


def _largest_term(bounds: Bounds) -> str:
    """The name of the term with the largest share of the largest error bound."""
    at = np.unravel_index(int(np.argmax(bounds.error)), bounds.error.shape)
    return max(bounds.terms, key=lambda name: float(bounds.terms[name][at]))


def motion_bound(
    arm: Articulated,
    motion: AbstractMotion,
    loop: JointLoop,
    uncertainty: ArmUncertainty,
    *,
    allowed: Any = None,
    bodies: BodyPoints | None = None,
) -> Verdict:
    """Certify the largest tracking error along a motion, for every arm in the band.

    The law is computed torque with the same loop in all joints; it evaluates its model at the middle of the period (see
    `joint_loop.JointLoop`). The verdict's `bound` has `error` and `velocity` per joint, and `terms`: the shares of the
    error bound, by cause, where the bound is largest. `error_over_time` is the error bound in each cell, and `times`
    are the times at which the cells begin.

    - `allowed`: largest allowed error, a scalar or [n], rad or m; None to compute the bound only.

    Raises DefinitionError as `certified_path` does.
    """
    certified = certified_path(arm, motion, loop, uncertainty, bodies=bodies)
    return verdict_of(certified, arm, allowed)


def verdict_of(
    certified: CertifiedPath,
    arm: Articulated,
    allowed: Any = None,
    premises: Sequence[Assumption] = (
        Assumption("no torque or torque rate limit acts, and the gate rejects no sample", "assumed"),
    ),
) -> Verdict:
    """Return the verdict for the error bounds along a motion.

    - `arm`: the nominal arm, for the names and units of its joints.
    - `allowed`: largest allowed error, a scalar or [n], rad or m; None if any verified bound will do.
    - `premises`: further assumptions that the verdict lists.
    """
    bounds, cells = certified.bounds, certified.path.cells
    error = bounds.error.max(axis=0)
    cell, joint = (int(i) for i in np.unravel_index(int(np.argmax(bounds.error)), bounds.error.shape))
    terms = {name: float(values[cell, joint]) for name, values in bounds.terms.items()}
    dominating = max(terms, key=lambda name: terms[name])
    where = f"{joint_label(arm.joint_names[joint])} at {cells.centres[cell]:.3g} s"
    if not bounds.verified:
        statement = (
            f"Not certified: no error bound below {WIDEST:g} rad exists for this motion. The bound grows without end "
            f"in {where}, mostly by {dominating}."
        )
        return Verdict(NAME, TITLE, False, None, {}, (_growth(dominating),), statement)
    margin = None
    holds = True
    if allowed is not None:
        limit = np.broadcast_to(np.asarray(allowed, float), error.shape)
        margin = float(np.min(1.0 - error / limit))
        holds = margin >= 0.0
    unit = arm.joint_units[joint]
    times = "of the motion and of the rest after it" if cells.until is None else f"up to {cells.until:.6g} s"
    statement = (
        f"For every arm within {certified.path.region.title}, no joint's error is larger than {joint_values(error)} "
        f"{unit} at any time {times}. The largest is that of {where}, mostly by "
        f"{dominating} ({100 * terms[dominating] / max(sum(terms.values()), 1e-300):.0f} %)."
    )
    bound = {
        "error": error,
        "velocity": bounds.velocity.max(axis=0),
        "terms": terms,
        "times": cells.centres - cells.half,
        "error_over_time": bounds.error,
    }
    return Verdict(NAME, TITLE, holds, margin, bound, (*_assumptions(certified), *premises), statement)


def _growth(dominating: str) -> Assumption:
    return Assumption(
        f"some bound satisfies all inequalities: they enlarge every bound below {WIDEST:g} rad, mostly by {dominating}",
        "fails",
    )


def _assumptions(certified: CertifiedPath) -> tuple[Assumption, ...]:
    cells, p = certified.path.cells, certified.path.region.p
    return (
        Assumption(
            f"the joint loop is stable for inertia ratios from {1 / (1 + p):.4g} to {1 / (1 - p):.4g}, and its kernels "
            "hold between the ratios that are computed, with their tails bounded",
            "proved",
        ),
        Assumption(
            f"the suprema hold at every time of {len(cells.q)} cells of {2e3 * cells.half:.3g} ms and in the tube "
            "around the motion, by Taylor's theorem with bounded remainders",
            "proved",
        ),
        Assumption("the bounds satisfy all inequalities, so that no error exceeds its bound first", "proved"),
    )
