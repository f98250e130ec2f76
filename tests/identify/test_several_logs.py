"""Several logs of one arm in one fit, each with its load; and gravity in an unknown direction."""

import json
import re
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

import slidax as sx
from slidax.arms import Payload
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import Conventions, identify, parse_load, write_arm
from slidax.scenarios import named_robot
from tests.cli.commands import in_process
from tests.identify.recorded import moved, recorded
from tests.identify.test_band import PAYLOAD, arm_with_drives, covered
from tests.identify.test_remedies import written

FILE = "tests/identify/three_link.urdf"
BLOCK = Payload(mass=as_array(1.5), center=as_array([0.0, 0.02, 0.05]), inertia=as_array(1e-3 * np.eye(3)))
TILTED = np.array([2.5, 1.2, -9.41])


def known_arm():
    return sx.arms.from_urdf(FILE)


def carrying(arm, load):
    return eqx.tree_at(lambda robot: robot.payload, arm, arm.payload.joined(load))


def in_gravity(arm, gravity):
    return eqx.tree_at(lambda robot: robot.gravity_vector, arm, as_array(gravity))


def log_of(seed, arm=None, *, rate=125.0, noise=0.01, seconds=12.0, lag=0.0):
    arm = arm_with_drives("three_link") if arm is None else arm
    motion = moved(seconds, rate, arm.joints, seed=3 + seed, size=2.0)
    return replace(recorded(arm, noise=noise, seed=seed, times_and_motion=motion, lag=lag), source=f"log {seed}")


def errors(result, name, truth):
    """Errors of a parameter in standard errors."""
    return (result.values(name) - np.asarray(truth)) / result.standard_errors(name)


@pytest.fixture(scope="module")
def two():
    """Logs with different rates, noises and torque delays."""
    logs = [log_of(0, rate=100.0, noise=0.03, lag=4e-3), log_of(1, rate=400.0, lag=-2e-3)]
    return logs, identify(logs, known_arm())


def test_logs_of_different_rates_noises_and_delays_are_fitted_together(two):
    logs, both = two
    arm = arm_with_drives("three_link")
    each = [identify(log, known_arm()) for log in logs]
    for name in ("armature", "coulomb", "viscous"):
        assert (np.abs(errors(both, name, getattr(arm, name))) < 4.0).all(), name
        least = np.minimum(*(single.standard_errors(name) for single in each))
        assert (both.standard_errors(name) < 1.1 * least).all(), name
    for fit, log, lag in zip(both.logs, logs, (4e-3, -2e-3), strict=True):
        assert fit.log.source == log.source and len(fit.t) == len(log.t)
        assert fit.split == int(0.75 * len(log.t))
        assert abs(fit.lag - lag) < 4.0 * fit.lag_error + 2e-4
        assert (fit.held_out_rms < 0.05 * fit.measured_rms).all()
    assert both.logs[0].lag_error > both.logs[1].lag_error


def part_of(log, rows):
    return replace(log, t=log.t[rows], q=log.q[rows], tau=log.tau[rows])


def joined(log, other):
    return replace(log, t=np.r_[log.t, other.t], q=np.r_[log.q, other.q], tau=np.r_[log.tau, other.tau])


@pytest.mark.parametrize(
    "copy",
    [
        lambda log: log,
        lambda log: replace(log, t=log.t + 100.0),
        lambda log: part_of(log, slice(400, None)),
        lambda log: part_of(log, slice(0, None, 2)),
        lambda log: replace(log, q=np.round(log.q, 6), tau=np.round(log.tau, 5)),
    ],
    ids=["the same", "at another time", "a part of it", "every second sample", "other digits"],
)
def test_a_log_with_a_copy_of_another_logs_measurements_is_refused(copy):
    log = log_of(0)
    copied = replace(copy(log), source="the copy")
    with pytest.raises(DefinitionError, match=r"\d+ samples of .*, from .* stand in .*, too: .*leave the copy out"):
        identify([log, copied], known_arm())


def test_a_log_with_a_copy_of_its_own_measurements_is_refused():
    log = log_of(0)
    with pytest.raises(DefinitionError, match="stand in log 0 from 100"):
        identify(joined(log, replace(log, t=log.t + 100.0)), known_arm())


def with_more_friction(arm, factor):
    return eqx.tree_at(lambda robot: (robot.coulomb, robot.viscous), arm, (factor * arm.coulomb, factor * arm.viscous))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda arm: carrying(arm, Payload(mass=as_array(0.1), center=as_array([0.0, 0.0, 0.05]))), "payload.mass"),
        (lambda arm: with_more_friction(arm, 1.2), "coulomb"),
    ],
    ids=["more load", "more friction"],
)
def test_intervals_from_logs_that_disagree_contain_the_true_values_of_both_arms(change, name):
    arm = arm_with_drives("three_link")
    result = identify([log_of(0), log_of(1, change(arm))], known_arm())
    assert any(
        "log 0 fits" in text and "times worse with the other logs than alone" in text for text in result.warnings
    )
    for each in (arm, change(arm)):
        truth = each.payload.mass if name == "payload.mass" else each.coulomb
        assert (np.abs(errors(result, name, truth)) < 2.0).all()


def test_logs_that_agree_cause_no_disagreement_warning(two):
    assert not any("with the other logs" in text for text in two[1].warnings)


def test_four_logs_with_equal_noise_about_halve_the_standard_errors_of_a_single_log():
    """Independent logs of one motion: errors fall by the square root of their number."""
    arm = arm_with_drives("three_link")
    motion = moved(12.0, 125.0, 3, seed=3, size=2.0)
    logs = [recorded(arm, seed=seed, times_and_motion=motion) for seed in range(4)]
    alone, four = identify(logs[0], known_arm(), cut_off=6.0), identify(logs, known_arm(), cut_off=6.0)
    assert [fit.log.source for fit in four.logs] == [f"a test (log {k})" for k in (1, 2, 3, 4)]
    for name in ("armature", "coulomb", "payload.mass"):
        ratio = four.standard_errors(name) / alone.standard_errors(name)
        # The rotor inertia of the first joint cannot be separated from the link's inertia about its axis.
        separable = ratio[1:] if name == "armature" else ratio
        assert (separable > 0.25).all() and (separable < 0.6).all(), name


def test_more_logs_make_the_band_narrower_and_it_contains_the_true_arm():
    arm, logs = arm_with_drives("three_link"), [log_of(seed) for seed in (0, 1, 2)]
    results = [identify(logs[:count], known_arm(), links=True) for count in (1, 3)]
    assert all(covered(result, arm) for result in results)
    assert results[1].band.p < 0.8 * results[0].band.p


def test_errors_and_warnings_name_the_log_that_they_concern(two):
    logs, _ = two
    with pytest.raises(DefinitionError, match=r"torques of log 1 do not fit .*`--torque-sign -1`"):
        identify([logs[0], replace(logs[1], tau=-logs[1].tau)], known_arm())
    with pytest.raises(DefinitionError, match=r"^log 1 is too short"):
        identify([logs[0], logs[1].rows(np.arange(250))], known_arm(), cut_off=6.0)
    keep = (logs[1].t < 4.0) | (logs[1].t > 6.0)
    warnings = identify([logs[0], logs[1].rows(keep)], known_arm()).warnings
    assert [words for words in warnings if "has a gap" in words and words.startswith("log 1")]


def test_an_unknown_load_in_a_log_is_identified_separately_from_the_arms_payload(tmp_path):
    logs = [log_of(0), log_of(1, carrying(arm_with_drives("three_link"), BLOCK))]
    result = identify(logs, known_arm(), loads=[Payload(), None])
    assert abs(errors(result, "load_2.mass", BLOCK.mass)[0]) < 4.0
    assert result.values("load_2.mass")[0] == pytest.approx(1.5, rel=0.02)
    assert float(result.robot.payload.mass) == result.values("payload.mass")[0] == pytest.approx(1.0, rel=0.02)
    write_arm(result, {"kind": "urdf", "file": FILE}, tmp_path / "arm.yaml")
    arm, _ = named_robot(str(tmp_path / "arm.yaml"))
    np.testing.assert_allclose(arm.payload.mass, result.robot.payload.mass, rtol=1e-7)
    alone = identify(logs[0], known_arm())
    assert result.band.p < 1.2 * alone.band.p
    known = identify(logs, known_arm(), loads=[Payload(), BLOCK])
    assert abs(errors(known, "payload.mass", 1.0)[0]) < 4.0
    assert known.standard_errors("payload.mass")[0] < result.standard_errors("payload.mass")[0]


def test_the_check_of_measured_torques_includes_the_known_load_of_the_log():
    heavy = Payload(mass=as_array(30.0), center=as_array([0.0, 0.0, 0.3]), inertia=as_array(0.1 * np.eye(3)))
    arm = arm_with_drives("three_link")
    log = recorded(carrying(arm, heavy), times_and_motion=moved(12.0, 125.0, 3, seed=3, size=2.0))
    # The first check of the torques includes the load; without the load the torques do not fit this arm.
    assert (identify(log, carrying(known_arm(), PAYLOAD), loads=[heavy], payload=False).values("coulomb") > 0.0).all()
    with pytest.raises(DefinitionError, match="torques of a test do not fit arm: its links and drives explain"):
        identify(log, carrying(known_arm(), PAYLOAD), payload=False)


def test_two_known_loads_identify_the_actuator_gains_although_the_link_masses_are_wrong():
    arm = arm_with_drives("three_link")
    heavy = eqx.tree_at(lambda robot: (robot.masses, robot.inertias), arm, (1.15 * arm.masses, 1.15 * arm.inertias))
    gains = np.array([0.85, 1.1, 0.9])
    logs = [log_of(0, heavy), log_of(1, carrying(heavy, BLOCK))]
    logs = [replace(log, tau=log.tau / gains) for log in logs]
    result = identify(logs, known_arm(), loads=[Payload(), BLOCK], links=True, actuator_map="gain")
    assert (np.abs(errors(result, "gain", gains)) < 4.0).all()
    assert result.standard_errors("gain").max() < 0.02
    trusting = identify(logs[0], carrying(known_arm(), PAYLOAD), payload=False, actuator_map="gain")
    assert np.abs(trusting.values("gain") - gains).max() > 0.05


@pytest.mark.parametrize("loads", [None, [Payload(), Payload()], [BLOCK, BLOCK], [None, BLOCK], [None, None]], ids=str)
def test_identifying_gains_and_links_without_a_known_load_difference_is_refused_with_the_remedy(loads, two):
    with pytest.raises(DefinitionError, match=r"needs known masses.*`--load none --load 2.0@0,0,0.1`"):
        identify(two[0], known_arm(), loads=loads, links=True, actuator_map="gain")


def test_loads_must_have_an_entry_for_each_log(two):
    with pytest.raises(DefinitionError, match=r"`loads` must have an entry for each of 2 logs.*; got 1: `--load none`"):
        identify(two[0], known_arm(), loads=[BLOCK])


def test_an_empty_list_of_logs_is_refused():
    with pytest.raises(DefinitionError, match="`log` must be a log or several"):
        identify([], known_arm())


def test_load_option_accepts_mass_centre_and_inertia_and_refuses_other_forms():
    assert parse_load("unknown") is None and float(parse_load("none").mass) == 0.0
    assert float(parse_load("2").mass) == 2.0
    load = parse_load("2.0@0,0.1,-0.2@1,2,3,0.1,0.2,0.3")
    np.testing.assert_allclose(load.center, [0.0, 0.1, -0.2])
    np.testing.assert_allclose(load.inertia, [[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 3]])
    np.testing.assert_allclose(parse_load("2@0,0,0@0.5").inertia, 0.5 * np.eye(3))
    for text in (
        "",
        "heavy",
        "nan",
        "1_5",
        "\uff12",
        "2@0,0,1_0",
        "2@0,0,inf",
        "2@0,0",
        "2@0,0,0.1@1,2",
        "1,2",
        "2@0,0,0@1@2",
    ):
        with pytest.raises(DefinitionError, match=r"`--load` takes none, unknown, or KG@X,Y,Z"):
            parse_load(text)
    with pytest.raises(DefinitionError, match=r"mass` must be >= 0 kg"):
        parse_load("-1")


@pytest.mark.parametrize("gravity", [TILTED, (0.0, 0.0, 9.81), (9.81, 0.0, 0.0)], ids=["tilted", "ceiling", "wall"])
def test_gravity_of_a_mounted_arm_is_identified_with_its_payload(gravity):
    gravity = 9.81 * np.array(gravity) / np.linalg.norm(gravity)
    result = identify(log_of(0, in_gravity(arm_with_drives("three_link"), gravity)), known_arm(), gravity=True)
    errors_of_axes = np.array([result.values(f"gravity.{axis}")[0] for axis in "xyz"]) - gravity
    deviations = np.array([result.standard_errors(f"gravity.{axis}")[0] for axis in "xyz"])
    assert (np.abs(errors_of_axes) < 4.0 * deviations + 1e-9).all() and deviations.max() < 0.1
    assert abs(errors(result, "payload.mass", 1.0)[0]) < 4.0
    np.testing.assert_allclose(np.linalg.norm(result.robot.gravity_vector), 9.81)
    assert "gravity.x" not in {parameter.name for parameter in result.unseen}


def test_the_arm_file_has_the_identified_gravity(tmp_path):
    result = identify(log_of(0, in_gravity(arm_with_drives("three_link"), TILTED)), known_arm(), gravity=True)
    write_arm(result, {"kind": "urdf", "file": FILE}, tmp_path / "arm.yaml")
    arm, _ = named_robot(str(tmp_path / "arm.yaml"))
    true, q = in_gravity(arm_with_drives("three_link"), TILTED), as_array([0.3, -0.7, 0.4])
    still = as_array(np.zeros(3))
    np.testing.assert_allclose(arm.bias(q, still), true.bias(q, still), atol=0.1)
    assert np.abs(np.asarray(known_arm().bias(q, still) - true.bias(q, still))).max() > 0.25


def test_gravity_components_that_no_torque_depends_on_are_reported_as_unidentifiable():
    # Turning a tilted arm about its vertical first joint acts on the torques like an offset of this joint.
    log = log_of(0, in_gravity(arm_with_drives("three_link"), TILTED))
    result = identify(log, known_arm(), gravity=True, encoder_offset=True)
    unseen = {parameter.label for parameter in result.unseen}
    assert {"encoder_offset of shoulder", "gravity.x", "gravity.y"} <= unseen and "gravity.z" not in unseen
    # A planar arm feels no gravity along its axes.
    planar = sx.arms.from_urdf("examples/robots/two_link.urdf", gravity=(0.0, -9.81, 0.0), armature=[0.3, 0.2])
    moving = recorded(planar, times_and_motion=moved(12.0, 125.0, 2))
    shown = {each.name: each.identifiable for each in identify(moving, planar, gravity=True).parameters}
    assert shown["gravity.x"] and not shown["gravity.z"]


@pytest.mark.parametrize(
    ("arm", "conventions", "words"),
    [
        (known_arm(), Conventions(add_gravity=True), "leave one of the two out"),
        (in_gravity(known_arm(), np.zeros(3)), None, r"`gravity` is 0 .*`--gravity 0,0,-9.81`"),
    ],
    ids=["added", "none"],
)
def test_gravity_identification_is_refused_for_added_or_zero_gravity(arm, conventions, words):
    log = recorded(arm, times_and_motion=moved(12.0, 125.0, arm.joints))
    with pytest.raises(DefinitionError, match=words):
        identify(log, arm, conventions=conventions, gravity=True)


def test_the_message_about_a_mounted_arm_names_the_option_that_identifies_gravity():
    log = log_of(0, in_gravity(arm_with_drives("three_link"), [0.0, 6.94, -6.94]))
    with pytest.raises(DefinitionError, match=r"`--gravity identify` estimates with an interval: `--gravity -?\d"):
        identify(log, known_arm())


def test_the_identify_command_fits_two_logs_with_loads_and_identifies_gravity(tmp_path):
    true = in_gravity(arm_with_drives("three_link"), TILTED)
    logs = [log_of(0, true), log_of(1, carrying(true, BLOCK))]
    paths = [str(written(log, tmp_path / f"{name}.csv")) for log, name in zip(logs, ("empty", "loaded"), strict=True)]
    options = ["--load", "none", "--load", "1.5@0,0.02,0.05@1e-3", "--gravity", "identify"]
    out = ["--out", str(tmp_path / "arm.yaml"), "--report", str(tmp_path / "report"), "--json"]
    result = in_process("identify", *paths, "--robot", FILE, *options, *out)
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    assert [log["source"] for log in answer["logs"]] == ["`empty.csv`", "`loaded.csv`"]
    values = {each["name"]: each["value"] for each in answer["parameters"]}
    assert values["gravity.x"] == pytest.approx(TILTED[0], abs=0.1)
    assert values["payload.mass"] == pytest.approx(1.0, rel=0.03)
    assert re.search(r"gravity: \[2\.[45]\d*", (tmp_path / "arm.yaml").read_text())
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "loaded.csv" in page and len(list((tmp_path / "report" / "figures").glob("*torques*.svg"))) == 2
    refused = in_process("identify", *paths, "--robot", FILE, "--load", "1.5kg", "--load", "none")
    assert refused.exit_code == 2 and "`--load` takes none, unknown, or KG@X,Y,Z" in refused.output


@pytest.mark.full
def test_intervals_and_bands_of_two_logs_have_their_stated_coverage():
    arm, inside, bands = arm_with_drives("three_link"), [], []
    for seed in range(40):
        result = identify([log_of(2 * seed), log_of(2 * seed + 1, noise=0.03)], known_arm(), links=True)
        bands.append(covered(result, arm))
        for name in ("armature", "coulomb", "viscous"):
            inside.extend(np.abs(errors(result, name, getattr(arm, name))) < 1.96)
    assert 0.92 <= np.mean(inside) <= 0.99 and np.mean(bands) >= 0.9
