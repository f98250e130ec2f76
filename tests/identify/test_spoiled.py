"""Logs that are spoiled are refused with the cause and its remedy, and clean ones are not."""

import re
from dataclasses import replace

import numpy as np
import pytest

import slidax as sx
from slidax.core.errors import DefinitionError
from slidax.identify import Conventions, identify
from tests.identify.recorded import recorded, true_arm
from tests.identify.spoiled import ARMS, KINDS, MOUNTED, Kind, clean_log, mounted, with_drives

EVERY_DAY = {kind.name: kind for kind in KINDS}


def judged(kind: Kind, name: str, seed: int) -> tuple[bool, str]:
    """True if a spoiled log was refused, and the words about it."""
    arm = ARMS[name]()
    log = clean_log(mounted(arm) if kind is MOUNTED else arm, seed)
    try:
        return False, " | ".join(identify(kind.spoil(log, np.random.default_rng(seed)), arm).warnings)
    except DefinitionError as error:
        return True, str(error)


@pytest.mark.parametrize("kind", [*KINDS, MOUNTED], ids=lambda kind: kind.name)
def test_a_spoiled_log_of_a_small_arm_is_named(kind):
    refused, words = judged(kind, "two_link", 1)
    assert refused == kind.refused, words
    assert re.search(kind.cause, words), words


@pytest.mark.full
def test_of_69_spoiled_logs_none_passes_in_silence_and_the_cause_is_named():
    rows = []
    for name in ARMS:
        for seed, kind in enumerate([*KINDS, MOUNTED]):
            refused, words = judged(kind, name, seed)
            rows.append((name, kind, refused, bool(re.search(kind.cause, words)), words))
    for name, kind, refused, named, words in rows:
        print(f"{name:9} {kind.name:44} {'refused' if refused else 'fitted':8} {'named' if named else words}")
    assert [row[:2] for row in rows if row[1].refused and not row[2]] == []
    assert [row[:2] for row in rows if not row[2] and not row[3]] == []
    assert sum(row[3] for row in rows) >= 63


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
def test_the_right_convention_gives_the_clean_logs_parameters(spoil, conventions):
    log, arm = recorded(true_arm(), seconds=6.0), sx.arms.ur5e()
    clean, repaired = identify(log, arm, cut_off=6.0), identify(spoil(log), arm, conventions=conventions, cut_off=6.0)
    for name in ("armature", "coulomb", "payload.mass"):
        np.testing.assert_allclose(repaired.values(name), clean.values(name), rtol=1e-6, atol=1e-9)


def test_a_gap_does_not_change_the_friction_by_more_than_its_error():
    arm = ARMS["two_link"]()
    log = clean_log(arm, 3)
    keep = (log.t < 6.0) | (log.t > 8.0)
    cut = log.rows(keep)
    true = with_drives(arm, np.random.default_rng(3))
    for name in ("coulomb", "viscous", "armature"):
        result = identify(cut, arm)
        off = np.abs(result.values(name) - np.asarray(getattr(true, name)))
        assert (off < 4.0 * result.standard_errors(name)).all(), name


def alarms(logs):
    """The refusals of clean logs, and their warnings other than on what the log does not show."""
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


def test_clean_logs_of_a_small_arm_raise_no_alarm():
    assert alarms(clean("two_link", seed) for seed in range(6)) == ([], [])


@pytest.mark.full
def test_of_90_clean_logs_none_is_refused_and_three_at_most_are_warned_of():
    """Encoders of up to 1 mrad at up to 1 kHz can leave a large error, which the warning then tells."""
    refusals, warnings = alarms(clean(name, seed) for name in ARMS for seed in range(30))
    assert refusals == []
    assert len(warnings) <= 3, warnings
    assert all("predicts the torque" in sentence for sentence in warnings)
