"""Identification of an arm's parameters from logs of positions and torques."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, count_noun
from slidax.core.joint_names import joint_label

from .band import EstimateErrors
from .checks import judge_result, require_torques, torque_sample
from .identified_arm import Identification, estimates_of, gravity_estimates, identified_robot
from .instruments import Instruments, in_commands, tangent
from .log_checks import require_no_copies
from .logs import Conventions, JointLog
from .records import has_known_difference, read_logs, record_of
from .regression import DISAGREE, ParameterFit, consistent_parameters, fit_parameters, with_disagreement
from .regressor import BODY
from .signals import LEAST, LogSignals
from .torque_model import gravity_direction, with_gravity
from .unknowns import Unknowns, sizes_of, unknowns_of

ROUNDS = 5
"""Largest number of linearisations of the torque equation about the estimates of encoder offsets, actuator map and
gravity."""

EXPLAINED = 0.5
"""The filter's band ends where the model leaves more than this share of the torque's power unexplained."""


def identify(
    log: JointLog | str | Path | Sequence[JointLog | str | Path],
    robot: Articulated,
    *,
    loads: Sequence[Payload | None] | None = None,
    conventions: Conventions | None = None,
    rotors: bool = True,
    payload: bool | None = None,
    links: bool = False,
    asymmetric: bool = False,
    stribeck: float | None = None,
    ripple: Sequence[float] = (),
    encoder_offset: bool = False,
    actuator_map: str | None = None,
    gravity: bool = False,
    cut_off: float | None = None,
    held_out: float = 0.25,
) -> Identification:
    """Estimate rotor inertias, friction, payload and, if `links`, the links' inertial parameters from logs.

        arm = identify("log.csv", sx.arms.panda())
        print(arm)

    The torque `τ = Y(q,q̇,q̈) φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_o` is linear in the parameters: the inertial
    parameters φ of payload and links with the regressor Y, rotor inertia J, Coulomb friction f_c, viscous friction f_v
    and offset f_o. So this is weighted least squares on signals that all pass the same zero-phase filter, with
    physically consistent bodies (`consistent_parameters`). The prior is very wide: it determines only the parameters
    that the log does not show, and warnings name them.

    The log is checked against the arm first: its time unit, gaps and velocities, and the sign, scale, joint order and
    gravity of its torques. `Conventions` has the remedies. Several logs of one arm are fitted together, each with its
    own rate, filter, noise and torque delay:

        two = [Payload(), Payload(mass=2.0, center=[0.0, 0.0, 0.1])]
        identify(["empty.csv", "loaded.csv"], arm, loads=two, links=True, actuator_map="gain")

    - `log`: a `JointLog`, or the path of a file that `read_log` reads; or several of them.
    - `robot`: the arm before identification; the identified parameters replace its own.
    - `loads`: for each log, the load at the tip in addition to the arm's own payload, in the tip's frame; `Payload()`
      for no load, None for an unknown one. By default no log has a load.
    - `conventions`: the logs' units, signs and joint order, where they differ from the arm's.
    - `rotors`: True to identify rotor inertias; torques measured behind the gears do not show them.
    - `payload`: True to identify the payload. By default it is identified unless `links` is True: the identified last
      link then includes the payload.
    - `links`: True to identify the links' inertial parameters; the prior of a link's mass is that of `robot` ± 50 %.
    - `asymmetric`: True if viscous friction may differ between the two directions.
    - `stribeck`: Stribeck velocity of static friction above Coulomb friction [rad/s or m/s]; by default there is none.
    - `ripple`: periods per turn of torque ripple, such as cogging, that all joints may have; by default there is none.
    - `encoder_offset`: True if the encoders' zeros are unknown. Gravity torques determine them, except for a first
      joint with a vertical axis and for a last joint with an unknown payload.
    - `actuator_map`: `gain` if each joint's torque is a multiple of its torque in the log; `full` if it combines all
      torques in the log, `τ = G τ_log`. Known masses determine the scale of G: those of the links or, with `links`,
      those of two different known `loads`.
    - `gravity`: True if the direction of gravity is unknown, as for an arm that is mounted at an angle.
    - `cut_off`: cut-off frequency of the filter [Hz]; chosen from the data by default.
    - `held_out`: share at the end of each log that is predicted and not fitted, in (0, 0.9].

    Raises DefinitionError if a log cannot be read or used, contradicts the arm, or leads to impossible parameters.
    """
    started = time.perf_counter()
    if not 0.0 < held_out <= 0.9:
        raise DefinitionError(f"`held_out` must be in (0, 0.9], the share of the log that is predicted; got {held_out}")
    if stribeck is not None and not (np.isfinite(stribeck) and stribeck > 0.0):
        raise DefinitionError(f"`stribeck` must be > 0 rad/s, the Stribeck velocity; got {stribeck:g}")
    if not all(np.isfinite(periods) and periods > 0.0 for periods in ripple) or len(set(ripple)) < len(ripple):
        raise DefinitionError(f"`ripple` must be different numbers > 0, the periods per turn; got {list(ripple)}")
    conventions = conventions or Conventions()
    logs = [log] if isinstance(log, (JointLog, str, Path)) else list(log)
    if not logs:
        raise DefinitionError("`log` must be a log or several; got an empty list")
    loads = [Payload()] * len(logs) if loads is None else list(loads)
    if len(loads) != len(logs):
        raise DefinitionError(
            f"`loads` must have an entry for each of {count_noun(len(logs), 'log')}, in their order; got {len(loads)}: "
            "`--load none` is a log without a load"
        )
    if actuator_map is not None and links and not has_known_difference(loads):
        raise DefinitionError(
            "`actuator_map` needs known masses: no log shows a factor that all torques and all masses have in common; "
            "leave `links` out, so that the masses in the arm's file set the scale, or take two logs with different "
            "known loads, such as `--load none --load 2.0@0,0,0.1`"
        )
    if gravity:
        _require_gravity(robot, conventions)
    Instruments.started(robot.joints, encoder_offset, actuator_map)
    records = [
        record_of(each, robot, conventions, load, cut_off, held_out)
        for each, load in zip(read_logs(logs, robot.joint_names), loads, strict=True)
    ]
    require_no_copies([record.pieces for record in records])
    equation = partial(
        unknowns_of,
        loads=loads,
        rotors=rotors,
        payload=not links if payload is None else payload,
        links=links,
        asymmetric=asymmetric,
        stribeck=stribeck,
        ripple=ripple,
    )

    def equations(arm: Articulated) -> list[Unknowns]:
        sizes = sizes_of([record.signals for record in records])
        return [
            equation(arm, record.signals, sizes, number=number, ignored=~record.usable)
            for number, record in enumerate(records)
        ]

    direction = None
    if gravity:
        samples = [torque_sample(record.slow, record.usable) for record in records]
        direction = gravity_direction([record.robot for record in records], samples)
        direction = np.asarray(robot.gravity_vector) if direction is None else direction
        robot = with_gravity(robot, direction)
    instruments = Instruments.started(robot.joints, encoder_offset, actuator_map, direction)
    unknowns = equations(robot)
    if not instruments.unknown:
        for record in records:
            require_torques(record.log, record.robot, record.slow, record.usable, conventions)
    fitted = fit_parameters(unknowns, [record.fitted for record in records])
    if cut_off is None:
        narrowed = [
            record.narrowed(explained_band(each, record.signals, fitted, slice(0, record.split)))
            for record, each in zip(records, unknowns, strict=True)
        ]
        if any(new is not old for new, old in zip(narrowed, records, strict=True)):
            records = narrowed
            unknowns = equations(robot)
            fitted = fit_parameters(unknowns, [record.fitted for record in records])
    axes = np.zeros((3, 0))
    if instruments.unknown:
        count, theta, before = len(unknowns[0].names), fitted.theta, np.zeros(0)
        for _ in range(ROUNDS):
            arm = instruments.robot(robot)
            unknowns = [
                instruments.extended(each, arm, record.signals, theta[:count])
                for each, record in zip(equations(arm), records, strict=True)
            ]
            fitted = fit_parameters(unknowns, [record.fitted for record in records])
            theta = fitted.theta
            axes = axes if instruments.gravity is None else tangent(instruments.gravity)
            instruments = instruments.refined(unknowns[0], theta, " and ".join(record.log.source for record in records))
            close = 0.02 * np.sqrt(np.diag(fitted.covariance))[count:]
            if len(before) and (np.abs(theta[count:] - before) < close).all():
                break
            # The angles of gravity start at 0 again, since they are relative to the last estimate.
            before = np.where(np.array(unknowns[0].names)[count:] == "gravity", 0.0, theta[count:])
        robot = instruments.robot(robot)
        for record in records:
            arm = instruments.robot(record.robot)
            require_torques(record.log, arm, instruments.corrected(record.slow), record.usable, conventions)
    fitted, ratios = with_disagreement(fitted, unknowns, [record.fitted for record in records])
    first = unknowns[0]
    inside = _inside(first, fitted.theta)
    theta = consistent_parameters(
        fitted.theta, fitted.information, first.bodies, first.positive, inside, far=len(records) > 1
    )
    # The barrier stops just above 0: a parameter there is on its bound.
    errors = np.sqrt(np.diag(fitted.covariance))
    theta = np.where(first.positive & (theta < 1e-3 * errors), 0.0, theta)
    fits = tuple(
        record.fit(each.known + each.columns @ theta, *lag)
        for record, each, *lag in zip(records, unknowns, fitted.lag.tolist(), fitted.lag_error.tolist(), strict=True)
    )
    warnings = tuple(sentence for record in records for sentence in record.signals.warnings + record.warnings)
    for record, ratio in zip(records, ratios, strict=True):
        joint = int(np.argmax(ratio))
        if ratio[joint] > DISAGREE:
            warnings += (
                f"{record.log.source} fits {ratio[joint]:.2g} times worse with the other logs than alone, most in the "
                f"torque of {joint_label(robot.joint_names[joint])}: the arm, its friction or its load differed. The "
                "intervals are widened to contain each log's own fit; `--load` sets the load of each log",
            )
    unknowns, fitted, theta = in_commands(unknowns, fitted, theta)
    first = unknowns[0]
    parameters = estimates_of(robot, first, fitted, theta)
    if gravity:
        angles = np.array(first.names) == "gravity"
        parameters += gravity_estimates(robot, axes, fitted.covariance[np.ix_(angles, angles)])
    identification = Identification(
        robot=identified_robot(robot, first, theta),
        parameters=parameters,
        logs=fits,
        condition=float(fitted.gain[0] / max(fitted.gain[-1], fitted.gain[0] * np.finfo(float).eps, 1e-300)),
        unseen_directions=int(np.sum(fitted.gain < 1.0)),
        warnings=warnings,
        seconds=time.perf_counter() - started,
        estimate=EstimateErrors(first.names, first.joints, first.bodies, theta, fitted.covariance),
    )
    doubts = judge_result(
        identification,
        robot,
        [record.signals for record in records],
        unknowns,
        fitted,
        [~record.usable for record in records],
    )
    return replace(identification, warnings=warnings + doubts)


def _require_gravity(robot: Articulated, conventions: Conventions) -> None:
    """Raise a DefinitionError if no log of the arm can show the direction of gravity."""
    if conventions.add_gravity:
        raise DefinitionError(
            "`gravity` cannot be identified from torques to which `add_gravity` adds the gravity torques of the arm's "
            "file: leave one of the two out"
        )
    if not np.asarray(robot.gravity_vector).any():
        raise DefinitionError("`gravity` is 0 in the arm's description: `--gravity 0,0,-9.81` sets its magnitude")


def explained_band(unknowns: Unknowns, signals: LogSignals, fitted: ParameterFit, rows: slice) -> float:
    """Return the frequency [Hz] up to which the model explains at least half of the torque's power.

    The result is the median over the joints. At higher frequencies the torque is noise, or an effect that the model
    lacks, such as elastic gears.

    - `unknowns`, `signals`: the torque equation and the signals of a log.
    - `fitted`: parameters of a first fit in a wider band.
    - `rows`: the fitted part of the log.
    """
    residual = (signals.tau - unknowns.known)[rows] - unknowns.columns[rows] @ fitted.theta
    part = signals.part(rows)
    f, residual_power = part.spectrum(residual, 4.0)
    _, torque_power = part.spectrum(signals.tau[rows], 4.0)
    octave = [(f >= high / 2) & (f <= high) for high in f[2:]]
    ends = []
    for joint in range(residual.shape[1]):
        shares = [residual_power[band, joint].sum() / max(torque_power[band, joint].sum(), 1e-300) for band in octave]
        bad = np.nonzero((np.array(shares) > EXPLAINED) & (f[2:] > LEAST))[0]
        ends.append(f[2 + bad[0]] if len(bad) else f[-1])
    return float(np.clip(np.median(ends), 2.0 * LEAST, signals.cut_off))


def _inside(unknowns: Unknowns, theta: np.ndarray) -> np.ndarray:
    """Return a θ inside the constraints: drive parameters are positive, and each body is a sphere about the origin."""
    inside = np.where(unknowns.positive, np.maximum(theta, 1e-3 * unknowns.scale), theta)
    for start in unknowns.bodies:
        mass = max(theta[start], 1e-2 * unknowns.scale[start])
        inside[start : start + BODY] = 0.0
        inside[start] = mass
        inside[start + 4 : start + 7] = mass * 1e-2
    return inside
