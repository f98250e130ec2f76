"""Identification of an arm's parameters from a log of positions and torques."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, count_noun

from .band import EstimateErrors
from .checks import find_usable_torques, judge_result, require_torques
from .identified_arm import Identification, estimates_of, identified_robot
from .instruments import Instruments, in_commands
from .log_checks import cut_at_gaps, remove_outliers, require_radians
from .log_files import read_log
from .logs import Conventions, JointLog
from .regression import ParameterFit, Unknowns, consistent_parameters, fit_parameters, unknowns_of
from .regressor import BODY
from .signals import LEAST, LogSignals, signals_of
from .torque_model import BAND, with_gravity_torques

SETTLINGS = 4
"""Least length of the fitted part between the filter's ends, in settling times of the filter."""

ROUNDS = 5
"""Linearisations of the equation about the errors of the instruments."""

EXPLAINED = 0.5
"""The band ends where the model leaves more than this share of the torque's power unexplained."""


def identify(
    log: JointLog | str | Path,
    robot: Articulated,
    *,
    conventions: Conventions | None = None,
    rotors: bool = True,
    payload: bool | None = None,
    links: bool = False,
    asymmetric: bool = False,
    stribeck: float | None = None,
    ripple: Sequence[float] = (),
    encoder_offset: bool = False,
    actuator_map: str | None = None,
    cut_off: float | None = None,
    held_out: float = 0.25,
) -> Identification:
    """Estimate rotor inertias, friction, payload and, if `links`, the links' inertial parameters from a log.

        arm = identify("log.csv", sx.arms.panda())
        print(arm)

    The torque is linear in the parameters, `τ = Y(q,q̇,q̈) φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_o`. So this is weighted
    least squares on signals that all pass the same zero-phase filter, with physically consistent bodies
    (`consistent_parameters`). The prior is very wide: it determines only the parameters that the log does not show, and
    these are listed by name.

    The log is checked against the arm first: its time unit, gaps and velocities, and the sign, scale, joint order and
    gravity of its torques. `Conventions` has the remedies.

    - `log`: a `JointLog`, or the path of a file that `read_log` reads.
    - `robot`: the arm as it is known; the identified parameters replace its own.
    - `conventions`: the log's units, signs and joint order, where they differ from the arm's.
    - `rotors`: True to identify rotor inertias; torques measured behind the gears do not show them.
    - `payload`: True to identify the payload; by default it is identified unless `links` is True, since the last link
      then contains it.
    - `links`: True to identify the links' inertial parameters; the prior of a link's mass is the file's value ± 50 %.
    - `asymmetric`: True if viscous friction may differ between the two directions.
    - `stribeck`: Stribeck velocity of static friction above Coulomb friction [rad/s or m/s]; by default there is none.
    - `ripple`: periods per turn of torque ripple, such as cogging, that all joints may have; by default there is none.
    - `encoder_offset`: True if the encoders' zeros are unknown. Gravity shows them, except for a first joint about
      the vertical, and for a last joint with an unknown payload.
    - `actuator_map`: `gain` if the torque of each drive is a multiple of the log's, `full` if it is a combination of
      those of all drives, `τ = G τ_log`. The known masses show the scale of G, so that `links` cannot be True.
    - `cut_off`: cut-off frequency of the filter [Hz]; chosen from the data by default.
    - `held_out`: share at the end of the log that is predicted and not fitted, in (0, 0.9].

    Raises DefinitionError if the log cannot be read or used, contradicts the arm, or leads to impossible parameters.
    """
    started = time.perf_counter()
    if not 0.0 < held_out <= 0.9:
        raise DefinitionError(f"`held_out` must be in (0, 0.9], the share of the log that is predicted; got {held_out}")
    if stribeck is not None and not (np.isfinite(stribeck) and stribeck > 0.0):
        raise DefinitionError(f"`stribeck` must be > 0 rad/s, the Stribeck velocity; got {stribeck:g}")
    if not all(np.isfinite(periods) and periods > 0.0 for periods in ripple) or len(set(ripple)) < len(ripple):
        raise DefinitionError(f"`ripple` must be different numbers > 0, periods per turn; got {list(ripple)}")
    if actuator_map is not None and links:
        raise DefinitionError(
            "`actuator_map` needs known masses: all torques and all masses may have a factor in common, which no log "
            "shows; leave `links` out, so that the masses in the arm's file give the scale"
        )
    instruments = Instruments.started(robot.joints, encoder_offset, actuator_map)
    if not isinstance(log, JointLog):
        log = read_log(log, robot.joint_names)
    if len(log.joints) != robot.joints:
        raise DefinitionError(
            f"{log.source} has {count_noun(len(log.joints), 'joint')}, but {robot.name} has {robot.joints}"
        )
    if payload is None:
        payload = not links
    conventions = conventions or Conventions()
    log = conventions.applied(log, robot.joint_units)
    if conventions.add_gravity:
        log = with_gravity_torques(log, robot)
    usable, sentences = find_usable_torques(log, robot, conventions)
    ignored = ~usable
    log, more = remove_outliers(log, robot)
    sentences += more
    require_radians(log, robot)
    pieces = cut_at_gaps(log, robot)
    log = pieces.log

    def equation(signals: LogSignals, arm: Articulated) -> Unknowns:
        options = {"rotors": rotors, "payload": payload, "links": links, "asymmetric": asymmetric}
        return unknowns_of(arm, signals, **options, stribeck=stribeck, ripple=ripple, ignored=ignored)

    signals = signals_of(pieces, robot, cut_off)
    split = int((1.0 - held_out) * len(signals.t))
    shortage = _shortage(signals, split, log)
    if shortage:
        raise DefinitionError(shortage)
    unknowns = equation(signals, robot)
    slow = signals if signals.cut_off <= BAND else signals_of(pieces, robot, BAND)
    if not (encoder_offset or actuator_map):
        require_torques(log, robot, slow, usable, conventions)
    fitted = fit_parameters(unknowns, signals, slice(0, split))
    if cut_off is None:
        band = explained_band(unknowns, signals, fitted, slice(0, split))
        if band < 0.8 * signals.cut_off:
            narrow = signals_of(pieces, robot, band)
            # A short log keeps its wider band: the noise there widens the intervals.
            if not _shortage(narrow, split, log):
                signals, unknowns = narrow, equation(narrow, robot)
                fitted = fit_parameters(unknowns, signals, slice(0, split))
    if encoder_offset or actuator_map:
        own, theta = len(unknowns.names), fitted.theta
        before = np.zeros(0)
        for _ in range(ROUNDS):
            arm = instruments.robot(robot)
            unknowns = instruments.extended(equation(signals, arm), arm, signals, theta[:own])
            fitted = fit_parameters(unknowns, signals, slice(0, split))
            theta = fitted.theta
            instruments = instruments.refined(unknowns, theta, log.source)
            close = 0.02 * np.sqrt(np.diag(fitted.covariance))[own:]
            if len(before) and (np.abs(theta[own:] - before) < close).all():
                break
            before = theta[own:]
        robot = instruments.robot(robot)
        require_torques(log, robot, instruments.corrected(slow), usable, conventions)
    theta = consistent_parameters(
        fitted.theta, fitted.information, unknowns.bodies, unknowns.positive, _inside(unknowns, fitted.theta)
    )
    # The barrier stops just above 0: a parameter there is on its bound.
    errors = np.sqrt(np.diag(fitted.covariance))
    theta = np.where(unknowns.positive & (theta < 1e-3 * errors), 0.0, theta)
    torque = unknowns.known + unknowns.columns @ theta
    torque = signals.filtered(torque - fitted.lag * signals.slope(torque))
    measured = signals.filtered(signals.tau)
    row = np.arange(len(torque))
    warnings = signals.warnings + tuple(sentences)
    unknowns, fitted, theta = in_commands(unknowns, fitted, theta)
    identification = Identification(
        robot=identified_robot(robot, unknowns, theta),
        parameters=estimates_of(robot, unknowns, fitted, theta),
        log=log,
        cut_off=signals.cut_off,
        condition=float(fitted.gain[0] / max(fitted.gain[-1], fitted.gain[0] * np.finfo(float).eps, 1e-300)),
        unseen_directions=int(np.sum(fitted.gain < 1.0)),
        lag=fitted.lag,
        lag_error=fitted.lag_error,
        t=signals.t,
        measured=measured,
        predicted=torque,
        split=split,
        fit_rms=_rms((measured - torque)[signals.inner & (row < split)]),
        held_out_rms=_rms((measured - torque)[signals.inner & (row >= split)]),
        measured_rms=_rms(measured),
        warnings=warnings,
        seconds=time.perf_counter() - started,
        estimate=EstimateErrors(unknowns.names, unknowns.joints, unknowns.bodies, theta, fitted.covariance),
    )
    doubts = judge_result(identification, robot, signals, unknowns, fitted, ignored)
    return replace(identification, warnings=warnings + doubts)


def explained_band(unknowns: Unknowns, signals: LogSignals, fitted: ParameterFit, rows: slice) -> float:
    """The frequency [Hz] up to which the model explains at least half of the torque's power, in the median joint.

    Above it the torque is noise, or an effect that the model lacks, such as elastic gears.

    - `unknowns`, `signals`: the equation and the log.
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


def _shortage(signals: LogSignals, split: int, log: JointLog) -> str:
    """A sentence if the filter leaves too few samples in the fitted part or in the held-out part; otherwise empty."""
    row, settled, rate = np.arange(len(signals.t)), signals.settled, signals.rate
    within = f" in {len(signals.pieces)} parts without a gap" if len(signals.pieces) > 1 else ""
    for name, rows, fewest in (("fitted", row < split, SETTLINGS * settled), ("held out", row >= split, settled // 2)):
        count = int(np.sum(signals.inner & rows))
        if count < fewest:
            return (
                f"{log.source} is too short, {len(row) / rate:.3g} s{within}: between the ends of its filter, "
                f"{settled / rate:.3g} s each in a band of {signals.cut_off:.3g} Hz, the part that is {name} has "
                f"{count / rate:.3g} s and needs {fewest / rate:.3g} s; `--held-out` and `--cut-off` set both"
            )
    return ""


def _inside(unknowns: Unknowns, theta: np.ndarray) -> np.ndarray:
    """A θ inside the constraints: positive drive parameters, and each body a sphere with its centre at the origin."""
    inside = np.where(unknowns.positive, np.maximum(theta, 1e-3 * unknowns.scale), theta)
    for start in unknowns.bodies:
        mass = max(theta[start], 1e-2 * unknowns.scale[start])
        inside[start : start + BODY] = 0.0
        inside[start] = mass
        inside[start + 4 : start + 7] = mass * 1e-2
    return inside


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))
