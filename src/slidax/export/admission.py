"""C99 code that admits or rejects motions: the inequalities of `slidax admit`, with the constants of one certified law.

Its tables are the worst-case impulse responses (kernels) of the joints' error loop. Each lag within the loop's memory
has its own entry; later lags share one per group. The C code sums the kernels over the cells of a motion, which are
short time intervals. It weights each lag by its age, since the inertia-weighted norm changes along the motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.certify.motion import (
    admission,
    fixed_point,
    hand_over,
    loop_kernels,
    path_cells,
    tracking_bound,
    tube_search,
)
from slidax.certify.motion.certified_law import CertifiedLaw
from slidax.certify.motion.fixed_point import DIRECT_SHARE, USED
from slidax.certify.motion.joint_loop import OUTPUTS, JointLoop
from slidax.certify.motion.loop_kernels import LoopKernel
from slidax.core.errors import DefinitionError
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario

from .c_project import CProject, write_files

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

KINDS = ("any_form", "ramp", "pulse", "noise", "goal", "step", "start_error", "start_speed", "start_miss")
"""Fields of a `LoopKernel` in the order of the C arrays. A group of lags has the sum of each of the first `SUMMED`
fields, and the largest value of each other field.
"""

SUMMED = 5
"""Number of fields, from the first in `KINDS`, that are summed over a group of lags."""

LANES = 4
"""Array lengths in innermost loops are multiples of this number, so that compilers vectorise the loops."""

BLOCK = 32
"""Number of lags in a group beyond the loop's memory."""

POWERS, PIECES, CELLS = 12, 256, 6144
"""Largest numbers that the C arrays can hold: coefficients per polynomial, pieces per motion, and cells per motion."""

FINE = 2**18
"""Number of transformed errors in a fine table of the plan (see `HandOver`). The C table is shorter; its error is
determined by comparison with the fine table.
"""

PLACES = 4097
"""Number of transformed errors in the C table of the plan, which the C code interpolates."""

FILES = {
    f"admission/{template}.j2": f"{{prefix}}_{name}"
    for template, name in (
        ("admission.h", "admission.h"),
        ("admission.c", "admission.c"),
        ("data.h", "admission_data.h"),
        ("arm.h", "admission_arm.h"),
        ("region.h", "admission_region.h"),
        ("cell.h", "admission_cell.h"),
        ("tube.h", "admission_tube.h"),
        ("motion.h", "admission_motion.h"),
        ("kernels.h", "admission_kernels.h"),
        ("loop.h", "admission_loop.h"),
    )
}

DOUBLES_ONLY = "the guarantee covers only a step in doubles: export without --float (single=False)"
"""Message that refuses an admission for a step in floats."""

OF_TRAJECTORIES = {f"onboard/guarantee.{end}.j2": f"{{prefix}}_guarantee.{end}" for end in ("c", "h")}


def export_admission(
    scenario: Scenario,
    exported: CProject,
    out: str | Path,
    *,
    trajectories: bool = False,
    certified: CertifiedLaw | None = None,
) -> None:
    """Write C code that admits or rejects motions for a scenario's law, into the folder `out` of its C project.

    - `exported`: the scenario's C project, with doubles.
    - `trajectories`: also write C code that applies this check to the trajectories that a robot's program receives.
    - `certified`: `CertifiedLaw.of(scenario)`, if it is already known.

    Raises DefinitionError if the step computes in floats, if no error bound covers the law (see `CertifiedLaw.of`), or
    if the folder cannot be written.
    """
    if exported.real != "double":
        raise DefinitionError(DOUBLES_ONLY)
    law, law_in_samples = certified or CertifiedLaw.of(scenario), scenario.controller
    assert isinstance(law_in_samples, SampledData)
    numbers = _Numbers.of(law, law_in_samples)
    allowed = admission.allowed_error(scenario)
    files = FILES | (OF_TRAJECTORIES if trajectories else {})
    write_files(
        exported,
        out,
        files,
        rest=numbers.macros["REST"],
        n=law.arm.joints,
        set=law.uncertainty.region(law.bodies).title,
        allowed=None if allowed is None else allowed.tolist(),
        powers=POWERS,
        pieces=PIECES,
        slow_downs=", ".join(map(repr, admission.SLOW_DOWNS)),
        halvings=admission.HALVINGS,
        outputs=", ".join(name.upper() for name in USED),
        direct_share=numbers.direct_share,
        macros=numbers.macros,
        arrays=numbers.arrays,
    )


@dataclass(frozen=True)
class _Array:
    """A constant array in C: its declaration up to the `=`, and its values as C source text."""

    declaration: str
    values: str


@dataclass(frozen=True)
class _Numbers:
    """C macros by name, C arrays, and the initialiser of the C array `direct_share`, for one certified law."""

    macros: dict[str, str]
    arrays: list[_Array]
    direct_share: str

    @classmethod
    def of(cls, law: CertifiedLaw, law_in_samples: SampledData) -> _Numbers:
        region, inputs, h = law.uncertainty.region(law.bodies), law.uncertainty.inputs(law.arm), law.loop.period
        kernels = _Kernels.of(law.loop, region.p)
        limited = bool(np.all(np.isfinite(inputs.torque_rate)))
        macros: dict[str, Any] = {
            "N": law.arm.joints,
            "CELLS": CELLS,
            "AXES": LANES * -(-len(region.deviations) // LANES),
            "OUTPUTS": LANES * -(-len(USED) // LANES),
            "PERIOD": h,
            "MASS_BAND": float(region.p),
            "DECAY": float(law.loop.decay),
            "REST": 2.0 * fixed_point.memory(law.loop),
            "MEMORY": kernels.memory,
            "COUNT": kernels.memory + 1,
            "LAGS": len(kernels.last),
            "GROUPS": len(kernels.growths),
            "RATIO_STEP": kernels.step,
            "LIMITED": int(limited),
            "SETTLED": int(inputs.settled),
            "CELL_TRAVEL": path_cells.CELL_TRAVEL,
            "SHORTEST_CELL": path_cells.SHORTEST_CELL,
            "LONGEST_CELL": path_cells.LONGEST_CELL,
            "FINER": tracking_bound.FINER,
            "WIDEST": tracking_bound.WIDEST,
            "ROUNDS": fixed_point.ROUNDS,
            "CONVERGED": fixed_point.SETTLED,
            "NEAR": fixed_point.NEAR,
            "WIDENINGS": fixed_point.WIDENINGS,
            "TINY": fixed_point.TINY,
            "TUBES": tube_search.TUBES,
            "PASSES": tube_search.PASSES,
            "TIGHTENING": tube_search.ROUNDS,
            "WIDE": tube_search.WIDE,
            "WIDE_TUBES": tube_search.WIDE_TUBES,
            "CONTINUOUS": CONTINUOUS,
            "HAND_OVER": int(law.hand_over is not None),
            "COVERED": np.inf if law.hand_over is None else law.hand_over.covered,
        }
        rate = inputs.torque_rate if limited else np.zeros(law.arm.joints)
        limits, bodies = law.arm.limits, law.bodies
        n = law.arm.joints
        ranges = [
            [np.broadcast_to(np.asarray(value, float), n) for value in both]
            for both in ((limits.lower, limits.upper), (-limits.velocity, limits.velocity))
        ]
        entries = [(p, q) for p in range(4) for q in range(p, 4)]
        weights = _in_lanes(np.array([region.deviations[:, :, p, q] for p, q in entries]).transpose(2, 0, 1))
        arrays = [
            _array("int parents[N]", np.asarray(bodies.parents, int)),
            _array("int revolute[N]", bodies.revolute.astype(int)),
            _array("int before[N][N]", bodies.before.astype(int)),
            _array("double rotations[N][3][3]", bodies.rotations),
            _array("double translations[N][3]", bodies.translations),
            _array("double body_points[N][4][4]", bodies.points),
            _array("double pseudo_inertias[N][4][4]", bodies.pseudo_inertias),
            _array("double rotors[N]", bodies.rotors),
            _array("double gravity[3]", bodies.gravity),
            _array("double cover_points[N][4][4]", region.points),
            _array("double cover_rotors[N]", region.rotors),
            _array("double range[2][2][N]", ranges),
            _array("double torque_limit[N]", law.torque),
            _array("double rate_limit[N]", law.torque_rate),
            _array("double viscous_nominal[N]", np.broadcast_to(np.asarray(law.arm.viscous, float), n)),
            _array("double coulomb[N]", inputs.coulomb),
            _array("double viscous[N]", inputs.viscous),
            _array("double viscous_error[N]", inputs.viscous_error),
            _array("double torque_disturbance[N]", inputs.torque),
            _array("double torque_rate[N]", rate),
            _array("double resolution[N]", inputs.resolution),
            _array("double start_error[N]", inputs.start_error),
            _array("double start_speed[N]", inputs.start_speed),
            *kernels.arrays,
        ]
        if region.has_ellipsoid:
            arrays += [
                _array("double deviations[N][10][AXES]", weights),
                _array("double rotor_deviations[N][AXES]", _in_lanes(region.rotor_deviations.T)),
            ]
        if law.hand_over is not None:
            plan = law.hand_over if law.hand_over.share else hand_over.HandOver.of(law_in_samples, FINE)
            assert plan is not None
            more, further = _plan(plan, n)
            macros, arrays = macros | more, arrays + further
        direct = ", ".join(repr(DIRECT_SHARE.get(name, 0.0) * h ** (2 - OUTPUTS[name])) for name in USED)
        return cls({name: _number(value) for name, value in macros.items()}, arrays, direct)


CONTINUOUS = 1e-6
"""Largest jump of a motion's position and velocity that counts as rounding, relative to 1 plus their size."""


@dataclass(frozen=True)
class _Kernels:
    """The impulse-response kernels of the joints' loop as C arrays.

    - `first`, `last`: first and last lag of each group [periods].
    - `growths`, `lengths`: growth rates [1/s], and the kernel length that suffices up to each of them [periods].
    - `memory`: number of periods after which the kernel of the error is small.
    - `step`: distance between two inertia ratios of the table; 0 if it has only one.
    - `arrays`: the C arrays.
    """

    first: Places
    last: Places
    growths: list[float]
    lengths: list[int]
    memory: int
    step: float
    arrays: list[_Array]

    @classmethod
    def of(cls, loop: JointLoop, p: float) -> _Kernels:
        memory = round(fixed_point.memory(loop) / loop.period)
        growths, lengths = _groups(loop, p)
        fine = min(memory + round(path_cells.LONGEST_CELL / loop.period) + 1, lengths[-1] + 1)
        cuts = {0, *range(1, fine + 1), *(length + 1 for length in lengths)}
        cuts |= set(range(fine, lengths[-1] + 1, BLOCK))
        starts = np.array(sorted(cut for cut in cuts if cut <= lengths[-1] + 1))
        first, last = starts[:-1], starts[1:] - 1
        base = loop_kernels.bare_kernels(loop, p, 0.0, lengths[-1])
        three = [base["nominal"], base["departure"], base["largest"]]
        rests = []
        for growth, length in zip(growths, lengths, strict=True):
            after = loop_kernels.bare_kernels(loop, p, growth, length, rest=True)
            weighted = loop_kernels.bare_kernels(loop, 0.0, growth, length, rest=True)["largest"]
            four = [after["nominal"], after["departure"], after["largest"], weighted]
            rests.append(
                [[[float(getattr(table[name], kind)[-1]) for name in USED] for kind in KINDS] for table in four]
            )
        ratios = loop_kernels.inertia_ratios(p)
        tables = [[_over_groups(kind, table, first) for kind in KINDS] for table in three]
        beyond = [[table[name].beyond for name in USED] for table in three]
        arrays = [
            _array("int lag_first[LAGS]", first),
            _array("int lag_last[LAGS]", last),
            _array("double group_growth[GROUPS]", growths),
            _array("int group_length[GROUPS]", lengths),
            _array("float kernels[3][9][LAGS][OUTPUTS]", _in_lanes(np.array(tables)), upwards=True),
            _array("double beyond[3][OUTPUTS]", _in_lanes(np.array(beyond))),
            _array("double rests[GROUPS][4][9][OUTPUTS]", _in_lanes(np.array(rests))),
        ]
        step = float(ratios[2] - ratios[1]) if p > 0.0 else 0.0
        return cls(first, last, growths, lengths, memory, step, arrays)


def _groups(loop: JointLoop, p: float) -> tuple[list[float], list[int]]:
    """Return growth rates [1/s], multiples of 0.25, and the kernel length that suffices up to each of them [periods].

    They reach half of the loop's decay rate, rounded up as in `Problem`, or end where kernels no longer exist.

    - `p`: band of the inertia ratio, from 1/(1 + p) to 1/(1 - p).
    """
    lengths: dict[int, float] = {}
    for quarter in range(int(np.ceil(2.0 * loop.decay)) + 1):
        try:
            lengths[loop_kernels.kernel_length(loop, p, 0.25 * quarter)] = 0.25 * quarter
        except DefinitionError:
            if not quarter:
                raise
            break
    return list(lengths.values()), list(lengths)


def _over_groups(kind: str, kernels: Mapping[str, LoopKernel], first: Places) -> Floats:
    """Return the sum or the largest value of a kernel field over each group of lags, [groups outputs].

    - `kind`: name of the field, from `KINDS`.
    - `kernels`: kernels by output.
    - `first`: first lag of each group [periods].
    """
    values = np.stack([getattr(kernels[name], kind) for name in USED], axis=1)
    combine = np.add if KINDS.index(kind) < SUMMED else np.maximum
    return np.asarray(combine.reduceat(values, first, axis=0))


def _plan(plan: hand_over.HandOver, n: int) -> tuple[dict[str, Any], list[_Array]]:
    """Return C macros by name, and C arrays, for the plan of a law with a sliding surface and n joints."""
    fine = plan.phi.shape[1]
    places = np.unique(np.round(np.linspace(1, fine - 1, PLACES)).astype(int))

    def lines(values: Floats, x: Floats) -> float:
        """Return a bound of the relative difference between the fine table and its linear interpolation."""
        line = np.interp(x, x[places - 1], values[places - 1])
        # Both functions increase, so the values at the ends of a step bound the values in between.
        return float(np.max([np.max(values[1:] / line[:-1]), np.max(line[1:] / values[:-1])]) - 1.0)

    frames = plan.frames(n)
    macros: dict[str, Any] = {
        "HORIZON": plan.horizon,
        "PLACES": len(places),
        "FRAMES": len(frames[0]),
        "LINEAR_PLAN": int(plan.share != 0.0),
    }
    arrays = [
        _array(f"double frame_{name}[FRAMES][N]", values)
        for name, values in zip(("now", "ahead", "room"), frames, strict=True)
    ]
    if plan.share:
        # The rows that Python uses, without the last transformed error, from which on there is no bound.
        even, some = np.ones((1, n)), places[places < plan.phi.shape[1] - 1] - 1
        rows = hand_over.HandOverCells(plan, even, even, even, np.zeros(n)).apart
        led, apart = (np.log(np.maximum([row[k][1:-1] for row in rows], fixed_point.TINY)) for k in range(2))
        macros |= {"PLACES": len(some), "PLAN_OFF": np.expm1(max(map(_off_in_logarithms, apart, led, [some] * n)))}
        arrays += [
            _array("double log_led[N][PLACES]", led[:, some]),
            _array("double log_apart[N][PLACES]", apart[:, some]),
        ]
        return macros, arrays
    # Joints with the same plan share a row.
    each = np.concatenate([plan.psi[0], plan.psi[1], plan.phi], axis=1)
    _, firsts, which = np.unique(each, axis=0, return_index=True, return_inverse=True)
    psi, phi = (np.maximum(table[..., 1:], fixed_point.TINY) for table in (plan.psi[:, firsts], plan.phi[firsts]))
    eps = np.geomspace(hand_over.LEAST, hand_over.LARGEST, fine - 1)
    macros |= {"PLAN_ROWS": len(firsts), "PLAN_OFF": max(lines(row, eps) for row in (*psi[0], *psi[1], *phi))}
    arrays += [
        _array("int plan_row[N]", which),
        _array("double plan_psi[PLAN_ROWS][2][PLACES]", psi[..., places - 1].swapaxes(0, 1)),
        _array("double plan_phi[PLAN_ROWS][PLACES]", phi[:, places - 1]),
    ]
    return macros, arrays


def _off_in_logarithms(values: Floats, x: Floats, places: Places) -> float:
    """Return a bound of the logarithmic difference between a fine table and its interpolation in logarithms.

    The fine table is interpolated linearly. Over one of its steps, linear and logarithmic interpolation differ by at
    most an eighth of the product of two steps.

    - `values`, `x`: logarithms of the table's values and of its arguments.
    - `places`: indices of the arguments that the interpolation uses.
    """
    line = np.interp(x, x[places], values[places])
    step = np.diff(values)
    return float(np.max(np.abs(values - line)) + 0.13 * np.max(step) * np.max(step + np.diff(x)))


def _in_lanes(values: Floats) -> Floats:
    """Return the array with its last axis padded by zeros to a multiple of `LANES`."""
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, -values.shape[-1] % LANES)])


def _number(value: Any) -> str:
    if isinstance(value, int | np.integer):
        return str(value)
    if np.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value))


def _array(declaration: str, values: Any, *, upwards: bool = False) -> _Array:
    """Return a constant array in C, with values in nested braces.

    - `upwards`: True to round the values up to single precision.
    """
    array = np.asarray(values)
    if upwards:
        rounded = array.astype(np.float32)
        array = np.where(rounded < array, np.nextafter(rounded, np.float32(np.inf)), rounded)

    def nested(part: Any) -> str:
        if part.ndim > 1:
            return "{" + ",\n".join(nested(row) for row in part) + "}"
        return "{" + ",".join(f"{value:.8e}f" if upwards else _number(value) for value in part) + "}"

    return _Array(f"static const {declaration}", nested(array))
