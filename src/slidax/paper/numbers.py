"""Comparison of computed and printed values, and values of the paper's inequalities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax import analysis
from slidax.analysis import index_sums
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law.envelopes import FixedTime
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.reaching_laws import FixedTimeReaching, TwoPowerReaching
from slidax.law.sliding_mode_controllers import SlidingMode
from slidax.law.surfaces import LinearCoreFixedTime, SingularityFree, SmoothFixedTime
from slidax.law.torque_bounds import UncertaintyBound
from slidax.report.page import significant
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run

from .examples import SCHEMES, Case, Reading, Runs
from .printed import (
    CLOSE,
    ENERGY_SHARE,
    STEADY_LIMIT,
    TABLE_3,
    Printed,
    PrintedComparison,
    compare_limit,
    compare_printed,
    mark_incomparable,
)


class Parts(NamedTuple):
    """A CFTSMPPC law and its parts, each with its class."""

    law: SlidingMode
    transformation: PrescribedPerformance
    performance: FixedTime
    surface: SmoothFixedTime
    reaching: FixedTimeReaching
    bound: UncertaintyBound


def parts_of(scenario: Scenario) -> Parts:
    """Return the CFTSMPPC law of a scenario, with its envelope, surface, reaching law and torque bound.

    - `scenario`: one of the examples.

    Raises DefinitionError if its scheme is not CFTSMPPC with a fixed-time envelope.
    """
    law = scenario.controller
    transformation = getattr(law, "transformation", None)
    performance = getattr(transformation, "performance", None)
    surface = getattr(law, "surface", None)
    reaching = getattr(law, "reaching", None)
    bound = getattr(law, "bound", None)
    if (
        isinstance(law, SlidingMode)
        and isinstance(transformation, PrescribedPerformance)
        and isinstance(performance, FixedTime)
        and isinstance(surface, SmoothFixedTime)
        and isinstance(reaching, FixedTimeReaching)
        and isinstance(bound, UncertaintyBound)
    ):
        return Parts(law, transformation, performance, surface, reaching, bound)
    raise DefinitionError(f"`{scenario.name}` must have the scheme cftsmppc with a fixed-time envelope")


def inverse_inertia(scenario: Scenario) -> dict[str, Any]:
    """Return the paper's bounds (47) of the inverse inertia, and the arm's own values, in one flat dictionary.

    `m1`, `m2` and `gamma` are the law's. The others are the arm's, over q2 in [-π, π], since the inertia of both arms
    depends only on q2: `eigenvalues`, `spectral` and `frobenius` are [least, largest] of the eigenvalues and of both
    norms of M⁻¹, and `mismatch` is the largest `‖M⁻¹M0 - I‖` in the spectral norm.

    - `scenario`: one of the examples.
    """
    parts = parts_of(scenario)
    law, bound = parts.law, parts.bound
    robot, n = scenario.plant.robot, law.joints
    positions = jnp.zeros((721, n)).at[:, 1].set(jnp.linspace(-jnp.pi, jnp.pi, 721))
    mass, nominal = (np.asarray(jax.vmap(arm.mass)(positions)) for arm in (robot, law.nominal))
    inverse = np.linalg.inv(mass)
    values = np.linalg.eigvalsh(inverse)
    frobenius = np.linalg.norm(inverse, axis=(1, 2))
    mismatch = np.linalg.norm(inverse @ nominal - np.eye(n), ord=2, axis=(1, 2))
    return {
        "m1": float(bound.inverse_inertia_min),
        "m2": float(bound.inverse_inertia_max),
        "gamma": float(bound.gamma),
        "eigenvalues": [float(values.min()), float(values.max())],
        "spectral": [float(values[:, -1].min()), float(values[:, -1].max())],
        "frobenius": [float(frobenius.min()), float(frobenius.max())],
        "mismatch": float(mismatch.max()),
    }


def settling_bound(scenario: Scenario) -> dict[str, Any] | None:
    """Return the settling-time bound `T_max = T_r + T_s` [s] by the paper's eqs. (48)-(50), and the deadlines [s].

    `bound` is T_max, `reaching` is T_r, and `sliding` is T_s of the slowest joint; `terms` has the two terms of T_r and
    of T_s. `deadlines` is None without an envelope. Eq. (50) uses `ρ0/2 >= 1/β` (Proposition 5), with the initial
    radius ρ0 and β of (26); without an envelope β = 1, so 2 replaces ρ0. For SFSMC, the exponents and gains of its own
    powers take the same roles. The result is None if the scheme is not a fixed-time scheme.

    - `scenario`: the scenario with the parameters.
    """
    law = scenario.controller
    if not isinstance(law, SlidingMode) or not isinstance(law.bound, UncertaintyBound):
        return None
    surface, reaching = law.surface, law.reaching
    if isinstance(surface, SmoothFixedTime | LinearCoreFixedTime):
        gains, powers = (surface.k1, surface.k2), (surface.p, surface.q)
    elif isinstance(surface, SingularityFree):
        gains, powers = (surface.c1, surface.c2), (surface.alpha, surface.beta)
    else:
        return None
    if isinstance(reaching, FixedTimeReaching):
        r, gain = float(reaching.exponent), np.asarray(reaching.gain)
    elif isinstance(reaching, TwoPowerReaching):
        r, gain = float(np.max(np.asarray(reaching.v1))), np.asarray(reaching.k1)
    else:
        return None
    n, both = law.joints, float(law.bound.inverse_inertia_min + law.bound.inverse_inertia_max)
    slowest = float(np.linalg.eigvalsh(gain * np.eye(n)).min())
    first = 2 / (float(law.bound.margin) * np.sqrt(both))
    second = 2 / (n ** ((1 - r) / 2) * slowest * both ** ((r + 1) / 2) * (r - 1))
    performance = getattr(law.transformation, "performance", None)
    radius = np.asarray(performance.initial) if isinstance(performance, FixedTime) else np.asarray(2.0)
    (k1, k2), (p, q) = (tuple(np.asarray(x) for x in pair) for pair in (gains, powers))
    near = 2 ** (-(p + 1) / 2) * radius / (k1 * (1 - p))
    far = 2 ** (-(q + 1) / 2) * radius / (k2 * (q - 1))
    worst = np.argmax(np.atleast_1d(near + far))
    terms = [float(np.broadcast_to(term, n)[worst]) for term in (near, far)]
    return {
        "terms": {"reaching": [float(first), float(second)], "sliding": terms},
        "reaching": float(first + second),
        "sliding": sum(terms),
        "bound": float(first + second) + sum(terms),
        "deadlines": np.broadcast_to(np.asarray(performance.deadline), n).tolist()
        if isinstance(performance, FixedTime)
        else None,
    }


def expected_error(scenario: Scenario, run: Run) -> list[float] | None:
    """Return the error at which the boundary layer of eq. (51) balances the disturbance τ_d, [n], rad or m.

    For an exact model, `‖s‖ ≈ s0 ‖τ_d‖/(u - ‖τ_d‖)`, at its maximum over the second half of the run, where s0 is the
    layer's half width and u the robust torque. Then `|e| ≈ ‖s‖/(k1 l1 β)`, with the surface's gain k1, l1 of (30), and
    `β = (1/ϑ + 1)/ρ∞`, which is (26) at e = 0, for the overshoot ϑ and the final radius ρ∞.

    - `scenario`: the simulated scenario.
    - `run`: its run. The result is None if the run has no log, or ended early.
    """
    law, transformation, performance, surface, reaching, _ = parts_of(scenario)
    if run.log is None or not run.outcome.ok:
        return None
    late = np.asarray(run.log.t) > 0.5 * float(run.t1)
    disturbance = eqx.filter_vmap(lambda t, q, dq: scenario.plant.disturbance(t, State(q=q, dq=dq)))
    forces = disturbance(*(jnp.asarray(x[late]) for x in (run.log.t, run.log.state.q, run.log.state.dq)))
    force, u = np.linalg.norm(forces, axis=1), np.asarray(run.log.signals["u"])[late]
    size = float((float(reaching.layer) * force / (u - force)).max())
    p, delta = np.asarray(surface.p), np.asarray(surface.delta)
    l1 = (p * p / 2 - 5 * p / 2 + 3) * delta ** (p - 1)
    beta = (1 / np.asarray(transformation.overshoot) + 1) / np.asarray(performance.final)
    errors = np.broadcast_to(size / (np.asarray(surface.k1) * l1 * beta), law.joints)
    return [float(error) for error in errors]


def printed_steady_error(run: Run) -> list[float] | None:
    """Return `max |e|` over the second half of the run, [n], rad or m; None if the run has no log, or ended early.

    In Example 4.2 the second half is the last full period of the motion.
    """
    if not run.outcome.ok or run.log is None:
        return None
    late = np.asarray(run.log.t) > 0.5 * float(run.t1)
    return [float(size) for size in np.abs(np.asarray(run.log.e)[late]).max(axis=0)]


def table_3(run: Run, quantity: str, band: float) -> list[float | None]:
    """Return a computed quantity of Table 3 for each joint; None for a joint without such a value.

    - `run`: a finished run with a log.
    - `quantity`: `settling_time`, `steady_error` or `peak_torque`.
    - `band`: settling band, rad or m.
    """
    if quantity == "steady_error":
        errors = printed_steady_error(run)
        return [None] * len(run.joint_units) if errors is None else [*errors]
    values = analysis.settling_time(run, band) if quantity == "settling_time" else analysis.peak_torque(run)
    # A run that is still outside the band at its end has no settling time.
    late = quantity == "settling_time"
    return [None if late and value >= float(run.t1) - 1e-9 else float(value) for value in values]


def worst_after_deadline(scenario: Scenario, run: Run) -> list[float] | None:
    """Return `max |e| / ρ∞` after the deadline T of each joint, [n]; None if the run ended before a deadline.

    - `scenario`: the simulated scenario.
    - `run`: its run, with a log.
    """
    performance = parts_of(scenario).performance
    if run.log is None or not run.outcome.ok:
        return None
    t, sizes = np.asarray(run.log.t), np.abs(np.asarray(run.log.e))
    deadline, final = (np.broadcast_to(np.asarray(x), run.joints) for x in (performance.deadline, performance.final))
    if t[-1] < deadline.max():
        return None
    return [float(sizes[t >= deadline[i], i].max() / final[i]) for i in range(run.joints)]


def torque_step_ratio(run: Run, halved: Run) -> tuple[list[float], list[float]]:
    """Return two ratios, each at half the period over the full period [n]: of the largest torque step, and of AICE.

    AICE (82) is the total variation of the torque. For a continuous torque the ratios are about 1/2 and 1; for a
    chattering torque they are not.

    - `run`: run at the full period.
    - `halved`: run at half the period.
    """
    pairs = [(analysis.max_torque_step(r), index_sums.aice(r)) for r in (run, halved)]
    (step, total), (half_step, half_total) = pairs
    return (half_step / step).tolist(), (half_total / total).tolist()


def chatter(run: Run, halved: Run) -> list[float | None]:
    """Return the ratio of AICE (82) at half the period to that at the full period [n]; None for joints without chatter.

    AICE, the total variation of the torque, does not depend on the period if the torque is continuous. It does if the
    torque jumps at every sample. A joint's torque counts as chattering if AICE changes by more than the share `CLOSE`.

    - `run`: run at the full period.
    - `halved`: run at half the period.
    """
    ratios = index_sums.aice(halved) / index_sums.aice(run)
    return [float(ratio) if abs(ratio - 1.0) > CLOSE else None for ratio in ratios]


Values = dict[str, float | None]


@dataclass(frozen=True)
class Row:
    """A printed number, and its comparison.

    - `scheme`: name of the scheme.
    - `quantity`: as in `Printed`; or `limit` for the error limit in the text, or `energy` for the energy share.
    - `place`, `name`: place and name of the quantity in the paper.
    - `joint`: number of the joint, as text; `all` for a value of all joints.
    - `unit`: unit of both values.
    - `printed`: the value as printed.
    - `compared_with`: description of the computed value.
    - `computed`, `verdicts`: computed value and verdict, by reading of the disturbance.
    """

    scheme: str
    quantity: str
    place: str
    name: str
    joint: str
    unit: str
    printed: str
    compared_with: str
    computed: Values
    verdicts: dict[str, PrintedComparison]


def numbers(runs: Runs) -> list[Row]:
    """Compare the printed numbers with the computed ones, and return a row for each number.

    These are the values of Table 3, the error limit in the text, and the energy share.
    """
    table = [row for scheme, items in TABLE_3.items() for item in items for row in _joints(runs, scheme, item)]
    return [*table, _limit(runs), _energy(runs, False), _energy(runs, True)]


def energy_share(runs: Runs, reading: Reading, layered: bool) -> float:
    """Return the control effort, ECI (81), of CFTSMPPC in percent of that of NFTSMC, both summed over the joints.

    - `reading`: reading of the disturbance.
    - `layered`: True for NFTSMC with the alternative boundary layer.
    """
    rival = _nftsmc(reading, layered)
    return float(100 * index_sums.eci(runs[Case("4.2", reading)]).sum() / index_sums.eci(runs[rival]).sum())


def _joints(runs: Runs, scheme: str, item: Printed) -> list[Row]:
    robot = runs.scenarios[Case("4.2", runs.readings[0])].plant.robot
    band = SCHEMES[scheme].band
    result = {reading: _judged(runs, Case("4.2", reading, scheme=scheme), item, band) for reading in runs.readings}
    units = {"settling_time": ("s",) * 3, "steady_error": robot.joint_units, "peak_torque": robot.torque_units}
    return [
        Row(
            SCHEMES[scheme].name,
            item.quantity,
            item.place,
            item.name,
            str(i + 1),
            units[item.quantity][i],
            text,
            item.compared_with,
            {reading: joints[i][0] for reading, joints in result.items()},
            {reading: joints[i][1] for reading, joints in result.items()},
        )
        for i, text in enumerate(item.texts)
    ]


def _judged(runs: Runs, case: Case, item: Printed, band: float) -> list[tuple[float | None, PrintedComparison]]:
    run = runs[case]
    values = table_3(run, item.quantity, band)
    verdicts = [
        compare_printed(printed, value, _absent(run, item.quantity, band))
        for printed, value in zip(item.values, values, strict=True)
    ]
    if item.quantity == "peak_torque":
        growth, first = chatter(run, runs[case.halved]), analysis.initial_torque(run)
        # A peak at the first sample is not due to chattering.
        verdicts = [
            verdict if ratio is None or value == float(start) else mark_incomparable(_chattering(ratio))
            for verdict, ratio, value, start in zip(verdicts, growth, values, first, strict=True)
        ]
    return list(zip(values, verdicts, strict=True))


def _chattering(ratio: float) -> str:
    return f"chatters (AICE × {significant(ratio, 2)})"


def _absent(run: Run, quantity: str, band: float) -> PrintedComparison | None:
    """Return the verdict for a missing settling time: a run that has not settled at its end differs from the paper."""
    if quantity == "settling_time" and run.outcome.ok:
        return PrintedComparison("differs", f"differs: still above {significant(band, 1)} at the end")
    return None


def _limit(runs: Runs) -> Row:
    errors = {reading: printed_steady_error(runs[Case("4.2", reading)]) for reading in runs.readings}
    worst: Values = {reading: None if joints is None else max(joints) for reading, joints in errors.items()}
    return Row(
        "CFTSMPPC",
        "limit",
        "Section 4",
        "|e_i| in steady state",
        "all",
        "rad, m",
        f"< {STEADY_LIMIT}",
        "largest |e| over the second half of the run",
        worst,
        {reading: compare_limit(float(STEADY_LIMIT), value) for reading, value in worst.items()},
    )


def _energy(runs: Runs, layered: bool) -> Row:
    computed: Values = {}
    verdicts: dict[str, PrintedComparison] = {}
    for reading in runs.readings:
        rival = _nftsmc(reading, layered)
        value = energy_share(runs, reading, layered)
        computed[reading], verdicts[reading] = value, compare_printed(float(ENERGY_SHARE), value)
        if not layered:
            ratios = [ratio for ratio in chatter(runs[rival], runs[rival.halved]) if ratio is not None]
            if ratios:
                verdicts[reading] = mark_incomparable("NFTSMC " + _chattering(max(ratios)))
    return Row(
        "CFTSMPPC",
        "energy",
        "Section 4",
        "ECI in percent of that of NFTSMC",
        "all",
        "%",
        ENERGY_SHARE,
        f"sums over the joints; {_nftsmc(runs.readings[0], layered).name}{'' if layered else ' as listed'}",
        computed,
        verdicts,
    )


def _nftsmc(reading: Reading, layered: bool) -> Case:
    case = Case("4.2", reading, scheme="nftsmc")
    return case.relayered if layered else case
