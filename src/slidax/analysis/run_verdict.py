"""The verdict of a run in a sentence: inside its envelope or not, the joint nearest to a bound, errors and torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.core.errors import percent
from slidax.core.joint_names import NUMBERED
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run

from .metric import Metric, short_names
from .metrics import envelope_margin, peak_torque, steady_error, tolerance_margin, tool_error, tool_turn


@dataclass(frozen=True)
class RunVerdict:
    """The verdict of a run, as sentences for a terminal or a report.

    - `good`: True if the run reached its end inside its envelope and inside its tolerance band, if it has them.
    - `sentence`: the verdict, with the joint nearest to its bound in the logged samples, or in all without a log.
    - `facts`: sentences on the largest steady error, the largest torque and the tool.
    """

    good: bool
    sentence: str
    facts: tuple[str, ...]


def run_verdict(scenario: Scenario, run: Run) -> RunVerdict:
    """Return the verdict of a finished `run` of a `scenario`; the run must not be a batch."""
    outcome = run.outcome
    facts = tuple(_facts(scenario, run))
    if not outcome.ok:
        return RunVerdict(False, outcome.message, facts)
    both = {"envelope": envelope_margin(run) if run.has_envelope else None, "tolerance band": tolerance_margin(run)}
    bounds = {name: margins for name, margins in both.items() if margins is not None}
    if not bounds:
        return RunVerdict(True, "The run reached its end; its controller has no envelope.", facts)
    for name, margins in bounds.items():
        worst = int(np.argmin(margins))
        if margins[worst] <= 0.0:
            share = percent(-float(margins[worst]))
            return RunVerdict(False, f"Outside the {name}: {_named(run, worst)}, by {share} of its width.", facts)
    name, margins = next(iter(bounds.items()))
    worst = int(np.argmin(margins))
    if run.log is None or run.log.envelope is None:
        closest = f"{_named(run, worst)}, {percent(float(margins[worst]))} of its width left"
    else:
        shares = bound_shares(run)
        sample, worst = (int(k) for k in np.unravel_index(np.nanargmax(shares), shares.shape))
        time = float(np.asarray(run.log.t)[sample])
        closest = f"{_named(run, worst)}, {percent(float(shares[sample, worst]))} of its bound at {time:.3g} s"
    return RunVerdict(True, f"Inside the {name}. Closest: {closest}.", facts)


def bound_shares(run: Run) -> np.ndarray:
    """Return the error relative to the bound on its side, at each logged sample [samples n]; 1 is the envelope's edge.

    - `run`: run with a log, of a scheme with an envelope.
    """
    assert run.log is not None
    assert run.log.envelope is not None
    e, envelope = np.asarray(run.log.e), run.log.envelope
    return np.abs(e) / np.where(e >= 0.0, np.asarray(envelope.upper), -np.asarray(envelope.lower))


def _named(run: Run, joint: int) -> str:
    """A joint in a sentence: "joint 2", `joint4` or `elbow`."""
    name = short_names(run.joint_names)[joint]
    return name if NUMBERED.fullmatch(name) else f"`{name}`"


def torque_limits(scenario: Scenario) -> np.ndarray | None:
    """Largest torque of the actuator of a `scenario` [n], N m or N; None if no joint has a limit."""
    actuator = scenario.plant.actuator
    if actuator is None:
        return None
    limits = np.broadcast_to(np.asarray(actuator.limits.torque), scenario.plant.robot.joints)
    return limits if np.isfinite(limits).any() else None


def _facts(scenario: Scenario, run: Run) -> list[str]:
    facts = []
    if (largest := _largest(steady_error, run)) is not None:
        value, joint, unit = largest
        facts.append(f"Steady error at most {value:.2g} {unit} ({joint}).")
    limits = torque_limits(scenario)
    if limits is not None and (torques := peak_torque(run)) is not None:
        shares = np.asarray(torques) / limits
        worst = int(np.argmax(shares))
        extent = "at its limit" if shares[worst] > 0.9995 else f"at most {percent(float(shares[worst]))} of its limit"
        facts.append(f"Torque {extent} ({_named(run, worst)}).")
    elif (largest := _largest(peak_torque, run)) is not None:
        value, joint, unit = largest
        facts.append(f"Torque at most {value:.3g} {unit} ({joint}); it has no limit.")
    if (error := tool_error(run)) is not None:
        turn = tool_turn(run)
        angle = "" if turn is None else f" and {turn:.2g} rad"
        facts.append(f"The tool is at most {error:.2g} m{angle} off its path.")
    return facts


def _largest(metric: Metric[np.ndarray | None] | Metric[np.ndarray], run: Run) -> tuple[float, str, str] | None:
    """Return the largest value of a metric with its joint and unit; None if a value is missing.

    Values of revolute and prismatic joints are compared as numbers, without their units.
    """
    values = metric(run)
    if values is None or not np.isfinite(values).all():
        return None
    worst = int(np.argmax(values))
    return float(values[worst]), _named(run, worst), metric.units(run)[worst]
