"""Spoiled logs are refused with the cause and its remedy, clean ones are not, damaged ones give finite numbers."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest

import slidax as sx
from slidax.arms import Articulated, Payload
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import Conventions, JointLog, identify
from tests.identify.recorded import moved, recorded, true_arm

Spoil = Callable[[JointLog, np.random.Generator], JointLog]


@dataclass(frozen=True)
class Kind:
    """A way to spoil a log.

    `cause` is a regular expression of the words that name it, in the error or in a warning.
    """

    name: str
    spoil: Spoil
    cause: str
    refused: bool = True


def two_link() -> Articulated:
    """A planar arm that hangs in gravity, with limits as a data sheet has them."""
    path = Path(__file__).parents[2] / "examples" / "robots" / "two_link.urdf"
    return sx.arms.from_urdf(str(path), gravity=(0.0, -9.81, 0.0), armature=[0.3, 0.2])


ARMS: dict[str, Callable[[], Articulated]] = {"two_link": two_link, "panda": sx.arms.panda, "ur5e": sx.arms.ur5e}


def with_drives(arm: Articulated, rng: np.random.Generator) -> Articulated:
    """The arm with rotors, friction and a payload by chance."""
    n = arm.joints
    limit = np.asarray(arm.limits.torque)
    rated = np.where(np.isfinite(limit), limit, 50.0)
    true: Articulated = eqx.tree_at(
        lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.payload),
        arm,
        (
            as_array(2e-3 * rated * rng.uniform(0.5, 2.0, n)),
            as_array(1e-2 * rated * rng.uniform(0.5, 2.0, n)),
            as_array(1e-2 * rated * rng.uniform(0.3, 1.5, n)),
            Payload(mass=as_array(rng.uniform(0.2, 1.5)), center=as_array([0.01, 0.0, 0.05]), inertia=as_array(2e-3)),
        ),
    )
    return true


def clean_log(
    arm: Articulated, seed: int, *, rate: float = 250.0, noise: float = 0.02, velocity: bool = True
) -> JointLog:
    """A log of the arm with drives by chance, on a motion by chance of 16 s."""
    rng = np.random.default_rng(seed)
    motion = moved(16.0, rate, arm.joints, seed=seed, size=1.2)
    log = recorded(with_drives(arm, rng), noise=noise, seed=seed, times_and_motion=motion)
    if not velocity:
        return log
    dq = motion[1].dq
    return replace(log, dq=dq + 0.01 * np.std(dq, axis=0) * rng.normal(size=dq.shape))


def _factor(joint: int | slice, factor: float) -> Spoil:
    def spoil(log: JointLog, rng: np.random.Generator) -> JointLog:
        tau = log.tau.copy()
        tau[:, joint] *= factor
        return replace(log, tau=tau)

    return spoil


def _interchanged(positions: bool, torques: bool) -> Spoil:
    def spoil(log: JointLog, rng: np.random.Generator) -> JointLog:
        order = np.arange(len(log.joints))
        a, b = (0, 1) if len(order) == 2 else (1, 3)
        order[[a, b]] = order[[b, a]]
        q = log.q[:, order] if positions else log.q
        dq = log.dq if log.dq is None or not positions else log.dq[:, order]
        return replace(log, q=q, dq=dq, tau=log.tau[:, order] if torques else log.tau)

    return spoil


def _late(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=np.stack([np.interp(log.t - 0.3, log.t, column) for column in log.tau.T], axis=1))


def _currents(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=log.tau / rng.uniform(6.0, 15.0, len(log.joints)))


def _constant(log: JointLog, rng: np.random.Generator) -> JointLog:
    tau = log.tau.copy()
    tau[:, 1] = 0.0
    return replace(log, tau=tau)


def _turned(log: JointLog, rng: np.random.Generator) -> JointLog:
    sign = np.ones(len(log.joints))
    sign[1] = -1.0
    return replace(log, q=log.q * sign, dq=None if log.dq is None else log.dq * sign)


def _offset(log: JointLog, rng: np.random.Generator) -> JointLog:
    q = log.q.copy()
    q[:, 1] += 0.5 * np.pi
    return replace(log, q=q)


def _without(log: JointLog) -> np.ndarray:
    return (log.t < 6.0) | (log.t > 8.0)


def _gap(log: JointLog, rng: np.random.Generator) -> JointLog:
    return log.rows(_without(log))


def _lines(log: JointLog, rng: np.random.Generator) -> JointLog:
    keep = _without(log)

    def filled(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(log.t, log.t[keep], column[keep]) for column in values.T], axis=1)

    return replace(log, q=filled(log.q), tau=filled(log.tau), dq=None if log.dq is None else filled(log.dq))


def _set_back(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, t=np.where(log.t > 7.0, log.t - 3.0, log.t))


def _noise(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=np.std(log.tau, axis=0) * rng.normal(size=log.tau.shape).cumsum(axis=0) / 50.0)


KINDS = (
    Kind("all torques with the opposite sign", _factor(slice(None), -1.0), r"--torque-sign -1`"),
    Kind("one torque with the opposite sign", _factor(1, -1.0), r"--torque-sign 1,-1"),
    Kind("torques of two joints interchanged", _interchanged(False, True), r"--torque-order"),
    Kind("two joints interchanged", _interchanged(True, True), r"--joint-order"),
    Kind("positions of two joints interchanged", _interchanged(True, False), r"--(position|torque)-order"),
    Kind("torques in mN m", _factor(slice(None), 1e3), r"--torque-unit mNm"),
    Kind("one torque in mN m", _factor(1, 1e3), r"--torque-scale 1,0.001"),
    Kind("torques on the motor's side", _factor(slice(None), 0.01), r"--torque-scale ([4-9]\d|1[0-4]\d)(\.\d+)?`"),
    Kind("motor currents", _currents, r"--torque-scale .*,"),
    Kind("torques all 0", _factor(slice(None), 0.0), r"all 0"),
    Kind("one torque all 0", _constant, r"--ignore-torque"),
    Kind("times in ms", lambda log, rng: replace(log, t=1e3 * log.t), r"--time-unit ms"),
    Kind("times in ns", lambda log, rng: replace(log, t=1.7e18 + 1e9 * log.t), r"--time-unit ns"),
    Kind(
        "positions in degrees",
        lambda log, rng: replace(log, q=np.degrees(log.q), dq=None if log.dq is None else np.degrees(log.dq)),
        r"--position-unit deg",
    ),
    Kind("torques 0.3 s late", _late, r"--torque-delay 0\.(29|3)"),
    Kind("one joint counts in the opposite direction", _turned, r"--position-sign 1,-1"),
    Kind("one zero turned by 90°", _offset, r"--position-offset 0,-1\.57"),
    Kind("a gap of 2 s", _gap, r"has a gap, the longest of 2", refused=False),
    Kind("a gap of 2 s that straight lines fill", _lines, r"straight lines for 2", refused=False),
    Kind("a clock that is set back", _set_back, r"clock was set back", refused=False),
    Kind("torques of nothing", _noise, r"varies by|noise alone|do not fit"),
    Kind(
        "positions in revolutions",
        lambda log, rng: replace(log, q=log.q / 2 / np.pi, dq=None if log.dq is None else log.dq / 2 / np.pi),
        r"--position-unit rev",
    ),
)
"""Kinds that spoil the log; `MOUNTED` spoils the arm's file."""

MOUNTED = Kind("an arm mounted at 45°", lambda log, rng: log, r"--gravity")


def mounted(arm: Articulated) -> Articulated:
    """The arm as it is, mounted at 45°: its file says upright."""
    g = np.linalg.norm(np.asarray(arm.gravity_vector)) * np.sqrt(0.5)
    down = (0.0, g, -g) if abs(float(arm.gravity_vector[2])) > 1.0 else (g, -g, 0.0)
    tilted: Articulated = eqx.tree_at(lambda robot: robot.gravity_vector, arm, as_array(down))
    return tilted


def judged(kind: Kind, name: str, seed: int) -> tuple[bool, str]:
    """True if a spoiled log was refused, and the words about it."""
    arm = ARMS[name]()
    log = clean_log(mounted(arm) if kind is MOUNTED else arm, seed)
    try:
        return False, " | ".join(identify(kind.spoil(log, np.random.default_rng(seed)), arm).warnings)
    except DefinitionError as error:
        return True, str(error)


@pytest.mark.parametrize("kind", [*KINDS, MOUNTED], ids=lambda kind: kind.name)
def test_a_spoiled_log_of_a_two_link_arm_is_reported_with_its_cause(kind):
    refused, words = judged(kind, "two_link", 1)
    assert refused == kind.refused, words
    assert re.search(kind.cause, words), words


@pytest.mark.full
def test_none_of_69_spoiled_logs_passes_in_silence_and_63_causes_are_named():
    rows = []
    for name in ARMS:
        for seed, kind in enumerate([*KINDS, MOUNTED]):
            refused, words = judged(kind, name, seed)
            rows.append((name, kind, refused, bool(re.search(kind.cause, words)), words))
    for name, kind, refused, named, words in rows:
        print(f"{name:9} {kind.name:44} {'refused' if refused else 'fitted':8} {'named' if named else words}")
    assert [row[:2] for row in rows if row[1].refused and not row[2]] == []
    assert [row[:2] for row in rows if not row[2] and not row[3]] == [] and sum(row[3] for row in rows) >= 63


@pytest.mark.parametrize(
    ("spoil", "conventions"),
    [
        (lambda log: replace(log, tau=-1e3 * log.tau), Conventions(torque_unit="mNm", torque_sign=[-1.0])),
        (lambda log: replace(log, t=1e3 * log.t), Conventions(time_unit="ms")),
        (lambda log: replace(log, t=250.0 * log.t), Conventions(time_unit="0.004")),
        (lambda log: replace(log, q=np.degrees(log.q)), Conventions(position_unit=["deg"])),
        (
            lambda log: replace(log, q=log.q[:, ::-1], tau=log.tau[:, ::-1]),
            Conventions(joint_order=sx.arms.ur5e().joint_names[::-1]),
        ),
        (
            lambda log: replace(log, tau=log.tau[:, [1, 2, 0, 3, 4, 5]]),
            Conventions(torque_order=[sx.arms.ur5e().joint_names[i] for i in (1, 2, 0, 3, 4, 5)]),
        ),
    ],
    ids=["unit and sign", "milliseconds", "counter", "degrees", "order", "torque order"],
)
def test_the_correct_log_convention_gives_the_parameters_of_the_clean_log(spoil, conventions):
    log, arm = recorded(true_arm(), seconds=6.0), sx.arms.ur5e()
    clean, repaired = identify(log, arm, cut_off=6.0), identify(spoil(log), arm, conventions=conventions, cut_off=6.0)
    for name in ("armature", "coulomb", "payload.mass"):
        np.testing.assert_allclose(repaired.values(name), clean.values(name), rtol=1e-6, atol=1e-9)


def test_friction_identified_from_a_log_with_a_gap_is_within_its_error():
    arm = ARMS["two_link"]()
    log = clean_log(arm, 3)
    result = identify(log.rows(_without(log)), arm)
    true = with_drives(arm, np.random.default_rng(3))
    for name in ("coulomb", "viscous", "armature"):
        off = np.abs(result.values(name) - np.asarray(getattr(true, name)))
        assert (off < 4.0 * result.standard_errors(name)).all(), name


def alarms(logs):
    """Refusals of clean logs, and their warnings except those about unidentifiable parameters."""
    refusals, warnings = [], []
    for log, arm in logs:
        try:
            result = identify(log, arm)
        except DefinitionError as error:
            refusals.append(str(error))
            continue
        warnings += [sentence for sentence in result.warnings if "does not show" not in sentence]
    return refusals, warnings


def clean(name, seed):
    rng = np.random.default_rng(100 + seed)
    arm = ARMS[name]()
    rate, noise = rng.choice([100.0, 250.0, 500.0, 1000.0]), rng.uniform(0.01, 0.05)
    log = clean_log(arm, seed, rate=float(rate), noise=float(noise), velocity=bool(rng.integers(2)))
    step = float(rng.choice([1e-5, 1e-4, 1e-3]))
    return replace(log, q=step * np.round(log.q / step)), arm


def test_clean_logs_of_a_two_link_arm_cause_no_refusal_or_warning():
    assert alarms(clean("two_link", seed) for seed in range(6)) == ([], [])


@pytest.mark.full
def test_none_of_90_clean_logs_is_refused_and_at_most_three_cause_warnings():
    """Encoders of up to 1 mrad at up to 1 kHz can leave a large error, which the warning then reports."""
    refusals, warnings = alarms(clean(name, seed) for name in ARMS for seed in range(30))
    assert refusals == []
    assert len(warnings) <= 3, warnings
    assert all("predicts the torque" in sentence for sentence in warnings)


def damaged(log: JointLog, rng: np.random.Generator) -> JointLog:
    """A log after one to three changes by chance."""
    for _ in range(rng.integers(1, 4)):
        name = str(rng.choice(["t", "q", "tau", "dq"]))
        values = np.array(getattr(log, name) if getattr(log, name) is not None else log.q)
        columns = slice(None) if values.ndim == 1 else rng.integers(values.shape[1])
        own = values[..., columns] if values.ndim > 1 else values
        match rng.integers(9):
            case 0:
                own = own * 10.0 ** rng.integers(-12, 13)
            case 1:
                own = 0.0 * own + rng.normal()
            case 2:
                own = own + 10.0 ** rng.integers(-3, 7) * rng.normal(size=own.shape)
            case 3:
                own = np.roll(own, rng.integers(len(own)))
            case 4:
                own = own[::-1]
            case 5:
                own = np.round(own, rng.integers(-2, 3))
            case 6:
                own = np.where(rng.random(len(own)) < 0.01, 10.0 ** rng.integers(0, 9), own)
            case 7:
                own = np.repeat(own[:: int(rng.integers(2, 300))], 300)[: len(own)]
                own = np.resize(own, len(log.t))
            case _:
                own = rng.permutation(own)
        if values.ndim == 1:
            values = own
        else:
            values[:, columns] = own
        log = replace(log, **{name: values})
    keep = np.sort(rng.permutation(len(log.t))[: int(rng.integers(250, len(log.t)))])
    if rng.random() < 0.3:
        log = log.rows(keep)
    return log


MANY = [pytest.param(name, range(100, 400 if name == "two_link" else 150), marks=pytest.mark.full) for name in ARMS]


# Seed 175 has a variance that rounding makes negative; seed 351 has a piece of three samples.
@pytest.mark.parametrize(("name", "seeds"), [("two_link", (*range(6), 175, 351)), *MANY])
def test_damaged_log_is_refused_or_gives_finite_numbers(name, seeds):
    arm = ARMS[name]()
    clean = clean_log(arm, 0).rows(np.arange(2000))
    fitted = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        log = damaged(clean, rng)
        options = {"links": bool(rng.random() < 0.3), "asymmetric": bool(rng.random() < 0.3)}
        try:
            result = identify(log, arm, **options)
        except DefinitionError:
            continue
        numbers = [(parameter.value, parameter.standard_error) for parameter in result.parameters]
        assert np.isfinite(numbers).all(), seed
        assert np.isfinite([result.fit_rms, result.held_out_rms, result.measured_rms]).all(), seed
        fitted += 1
    assert 0 < fitted < len(seeds)
