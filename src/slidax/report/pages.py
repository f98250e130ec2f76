"""HTML reports of a run, a study, certificates, a linearised loop and an identification."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax.analysis.metric import Metric, short_names
from slidax.analysis.metrics import envelope_margin, metrics_of, peak_torque, steady_error
from slidax.analysis.run_verdict import bound_shares, run_verdict, torque_limits
from slidax.arms.arm import AbstractRobot
from slidax.certify.sampled_scenario import envelope_bounds, has_envelope
from slidax.core.errors import DefinitionError
from slidax.identify.identified_arm import Identification
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.yaml_text import as_yaml
from slidax.simulation.run import Run
from slidax.studies.study import AbstractResult, AbstractStudy, Chart

from . import figures
from .files import parameters, write_scenario
from .page import Picture, picture, write_page


def tip_paths(robot: AbstractRobot, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Return the actual and the desired tip positions at the logged times, [samples 3] each, m.

    - `robot`: the arm, for its kinematics.
    - `run`: run with a log.

    Raises DefinitionError if the run has no log.
    """
    if run.log is None:
        raise DefinitionError("this run has no log, which the tip path needs: simulate with `log_every=10`, not None")
    tips = eqx.filter_jit(eqx.filter_vmap(robot.tip))
    actual, desired = (tips(jnp.asarray(q)) for q in (run.log.state.q, run.log.reference.q))
    return np.asarray(actual), np.asarray(desired)


def write_run_report(
    scenario: Scenario,
    run: Run,
    out: str | Path,
    *,
    also: Sequence[Metric[Any]] = (),
    command: str = "",
    cause: str = "",
) -> Path:
    """Write `report.html` and `figures/*.svg` to the folder `out`, and return the page's path.

    - `scenario`, `run`: a scenario with its run; without a log the page has no figures.
    - `also`: additional metrics. A metric defined in a paper is listed only for scenarios from this paper.
    - `command`: command line, for the page.
    - `cause`: a sentence on the likeliest cause of a failure.
    """
    metrics = [m for m in (*metrics_of(run), *also) if m.per_joint and m.source in scenario.description.source]
    overview, pictures = _run_pictures(scenario, run, Path(out, "figures"))
    return write_page(
        out,
        "run.html.j2",
        scenario=scenario,
        run=run,
        verdict=run_verdict(scenario, run),
        cause=cause,
        joints=short_names(run.joint_names),
        columns=_joint_columns(scenario, run),
        rows=[(metric, _unit_of(metric.units(run)), metric.shown(run)) for metric in metrics],
        overview=overview,
        pictures=pictures,
        parameters=parameters(scenario),
        seconds=run.timing.compile_s + run.timing.run_s if run.timing else 0.0,
        command=command,
    )


def _unit_of(units: Sequence[str]) -> str:
    """Return the units of a row without repetitions: "rad, m" for an arm with revolute and prismatic joints."""
    return ", ".join(dict.fromkeys(units))


def _joint_columns(scenario: Scenario, run: Run) -> list[tuple[str, str, list[float | None]]]:
    """Return the columns of the joint table: title, unit, and one value per joint; None for a missing value."""
    columns = [("Steady error", _unit_of(steady_error.units(run)), steady_error.shown(run))]
    if run.has_envelope:
        columns.insert(0, _envelope_column(run))
    columns.append(("Peak torque", _unit_of(peak_torque.units(run)), peak_torque.shown(run)))
    if (limits := torque_limits(scenario)) is not None:
        used = [None if tau is None else 100.0 * tau / c for tau, c in zip(peak_torque.shown(run), limits, strict=True)]
        columns.append(("Peak torque", "% of its limit", used))
    return columns


def _envelope_column(run: Run) -> tuple[str, str, list[float | None]]:
    """Return the largest error as a share of its bound; without a log, the least margin to the envelope."""
    if run.log is None or not len(np.atleast_1d(run.log.t)):
        left = [None if value is None else 100.0 * value for value in envelope_margin.shown(run)]
        return "Envelope margin", "% of its width", left
    return "Error", "% of its bound, at most", [100.0 * float(share) for share in np.nanmax(bound_shares(run), axis=0)]


def _run_pictures(scenario: Scenario, run: Run, folder: Path) -> tuple[Picture | None, list[Picture]]:
    """Return the figure with all joints in one panel, None without an envelope, and the figures by joint."""
    if run.log is None or len(np.atleast_1d(run.log.t)) < 2:
        return None, []
    overview = None
    if run.has_envelope:
        caption = (
            "Error of every joint as a share of its bound at that time. The joint that comes nearest to its envelope "
            "is blue."
        )
        overview = picture(figures.envelope_share(run), folder, "envelope-share", "Errors in the envelope", caption)
    inside = " in its envelope" if run.has_envelope else ""
    torque = figures.torque(run, limits=torque_limits(scenario))
    specs = [
        (
            "tracking-error",
            "Tracking error",
            f"Left: the error{inside}. Right: its absolute value.",
            figures.tracking_error(run),
        ),
        (
            "velocity-error",
            "Velocity error",
            "Left: the beginning. Right: the absolute value over the whole run.",
            figures.velocity_error(run),
        ),
        ("torque", "Torque", "Left: the whole run. Right: its beginning.", torque),
        ("tip-path", "Path of the tip", "Actual and desired.", figures.tip_path(*tip_paths(scenario.plant.robot, run))),
    ]
    return overview, [picture(figure, folder, name, title, caption) for name, title, caption, figure in specs]


def write_study_report(
    study: AbstractStudy, result: AbstractResult, out: str | Path, *, seconds: float, command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg`, `results.json` and scenarios to the folder `out`; return the page's path.

    - `study`, `result`: a study and its result.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    scenarios = result.scenarios()
    for name, description in scenarios.items():
        write_scenario(description, Path(out, f"{name}.yaml"))
    sections = [
        (section, [_picture(chart, Path(out, "figures")) for chart in section.figures]) for section in result.sections()
    ]
    return write_page(
        out,
        "study.html.j2",
        data={"results.json": result.as_json()},
        title=study.title or f"{study.scenario}: {study.study.replace('_', ' ')}",
        kind=study.study.replace("_", " "),
        result=result,
        sections=sections,
        scenarios={name: as_yaml(description) for name, description in scenarios.items()},
        parameters={"The study": as_yaml(study)},
        seconds=seconds,
        command=command,
    )


def _picture(chart: Chart, folder: Path) -> Picture:
    figure = getattr(figures, chart.kind)(*chart.values)
    return picture(figure, folder, chart.name, chart.title, chart.caption)


if TYPE_CHECKING:
    from slidax.certify.certify import Certificates


def write_certificate_report(
    scenario: Scenario, certificates: Certificates, out: str | Path, *, seconds: float, command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg` and `certificate.json` to the folder `out`, and return the page's path.

    - `scenario`, `certificates`: a scenario with its certificates.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    return write_page(
        out,
        "certificate.html.j2",
        data={"certificate.json": certificates.as_json()},
        scenario=scenario,
        certificates=certificates,
        pictures=_certificate_pictures(scenario, certificates, Path(out, "figures")),
        parameters={"The scenario": as_yaml(scenario.description)},
        seconds=seconds,
        command=command,
    )


def _certificate_pictures(scenario: Scenario, certificates: Certificates, folder: Path) -> list[Picture]:
    t = np.linspace(0.0, scenario.t1, 801)
    envelope, bounds = (
        envelope_bounds(scenario, t) or _tolerance_bounds(scenario, t),
        _bounds(certificates, scenario.t1),
    )
    if envelope is None or not bounds:
        return []
    plant = scenario.plant
    robot = getattr(plant, "own", plant).robot
    radii = np.sort(np.abs(np.stack(envelope)), axis=0)
    name = "envelope" if has_envelope(scenario) else "tolerance band"
    caption = f"Absolute values of both sides of the {name}, and the certified bounds of |e| with their grades."
    figure = figures.bounded_error(t, radii, bounds, short_names(robot.joint_names), robot.joint_units)
    return [picture(figure, folder, "bounded-error", "Bound of the error", caption)]


def _tolerance_bounds(scenario: Scenario, t: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the lower and the upper bound of the tolerance band for the scenario's initial error, [times joints] each.

    None if the scenario has no tolerance band.
    """
    band = scenario.tolerance
    if band is None:
        return None
    start = jnp.zeros(())
    error = scenario.state0.q - scenario.trajectory.reference(start).q
    sides: Any = eqx.filter_vmap(band.envelope, in_axes=(0, None))(jnp.asarray(t), band.init(start, error))
    return np.asarray(sides.lower), np.asarray(sides.upper)


def _bounds(certificates: Certificates, t1: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return times [k], s, and bounds of |e| [k joints] by legend label, from the certificates that hold."""
    bounds: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for verdict in certificates:
        if not verdict.holds:
            continue
        bound: Any = verdict.bound
        if "error_over_time" in bound:
            bounds[f"at this sample rate, grade {verdict.grade}"] = (
                np.asarray(bound["times"], float),
                np.asarray(bound["error_over_time"], float),
            )
        elif verdict.name == "ultimate_bound":
            error = np.asarray(bound["error"], float)
            bounds[f"ultimate bound, grade {verdict.grade}"] = np.array([0.75 * t1, t1]), np.stack([error, error])
    return bounds


if TYPE_CHECKING:
    from slidax.analysis.linearise import LinearisedLoop

LOOP_POINTS = {
    "torque": "broken at the torque, between law and drives",
    "measurement": "broken at the measured positions",
}


def write_linear_report(
    scenario: Scenario, linear: LinearisedLoop, out: str | Path, *, seconds: float, command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg` and `linear.json` to the folder `out`, and return the page's path.

    - `scenario`, `linear`: the closed loop, and its linearisation.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    has_margins = linear.held and linear.stable
    return write_page(
        out,
        "linear.html.j2",
        data={"linear.json": linear.as_json()},
        scenario=scenario,
        linear=linear,
        margins={where: linear.margins(where) for where in LOOP_POINTS} if has_margins else {},
        together={where: linear.simultaneous_margins(where) for where in LOOP_POINTS} if has_margins else {},
        points=LOOP_POINTS,
        joints=short_names(linear.joint_names),
        pictures=_loop_pictures(linear, Path(out, "figures")) if has_margins else [],
        parameters={"The scenario": as_yaml(scenario.description)},
        seconds=seconds,
        command=command,
    )


def _loop_pictures(linear: LinearisedLoop, folder: Path) -> list[Picture]:
    # At exactly half of the sampling frequency, the open loop L may be 0, which a logarithmic axis cannot show.
    omega = np.geomspace(1e-4, 0.99, 800) * np.pi / linear.system.period
    names = short_names(linear.joint_names)
    pictures = []
    for where, title in LOOP_POINTS.items():
        closed = linear.closed_loop(where).response(omega)
        loops = {name: -closed[:, k, k] / (1.0 + closed[:, k, k]) for k, name in enumerate(names)}
        caption = "Open loop of each joint with the other joints' loops closed, up to half of the sampling frequency."
        figure = figures.bode(omega, loops, title)
        pictures.append(picture(figure, folder, f"bode-{where}", f"Bode, {where}", caption))
        disks = {margin.where: margin.disk for margin in linear.margins(where) or []}
        caption = "The same open loops in the complex plane. The circle shows the smallest disk margin of the joints."
        figure = figures.nyquist(loops, disks, title)
        pictures.append(picture(figure, folder, f"nyquist-{where}", f"Nyquist, {where}", caption))
    return pictures


def write_identification_report(identification: Identification, out: str | Path, *, command: str = "") -> Path:
    """Write `report.html` and `figures/*.svg` for an `identification` to the folder `out`; return the page's path.

    - `command`: command line, for the page.
    """
    torques = [
        picture(
            figures.identified_torques(identification.robot, fit),
            Path(out, "figures"),
            f"identified-torques-{k + 1}" if k else "identified-torques",
            f"Torques of {fit.log.source.replace('`', '')}" if len(identification.logs) > 1 else "Torques",
            "Measured and predicted torques in the filter's band, and their difference. The shaded part was held out.",
        )
        for k, fit in enumerate(identification.logs)
    ]
    joint = int(np.argmax(identification.held_out_rms))
    robot = identification.robot
    return write_page(
        out,
        "identification.html.j2",
        identification=identification,
        rows=[(parameter, *parameter.as_text()) for parameter in identification.parameters],
        worst=(robot.joint_names[joint], identification.held_out_rms[joint], robot.torque_units[joint]),
        torques=[
            ("Measured", identification.measured_rms),
            ("Error, fitted part", identification.fit_rms),
            ("Error, held-out part", identification.held_out_rms),
        ],
        pictures=torques,
        parameters={},
        seconds=identification.seconds,
        command=command,
    )
