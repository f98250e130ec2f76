"""The option that an error of `slidax identify` names makes the same command work."""

import re
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from typer.testing import CliRunner

import slidax as sx
from slidax.cli import app
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import JointLog
from slidax.scenarios import named_robot
from tests.identify.recorded import moved, recorded

FILE = Path("tests/identify/three_link.urdf")
COULOMB = [1.5, 1.2, 0.6]


def written(log: JointLog, path: Path) -> Path:
    parts = {"q": log.q, "dq": log.dq, "tau": log.tau}
    columns = {
        f"{name}_{i + 1}": values[:, i] for name, values in parts.items() if values is not None for i in range(3)
    }
    table = np.column_stack([log.t, *columns.values()])
    np.savetxt(path, table, delimiter=",", fmt="%.8g", header=",".join(["time", *columns]), comments="")
    return path


def log_of(gravity=(0.0, 0.0, -9.81), held=()):
    arm = sx.arms.from_urdf(str(FILE))
    true = eqx.tree_at(
        lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.gravity_vector),
        arm,
        tuple(as_array(values) for values in ([0.05, 0.1, 0.05], COULOMB, [0.8, 0.6, 0.3], gravity)),
    )
    return recorded(true, times_and_motion=moved(12.0, 100.0, 3, seed=4, size=0.8), noise=0.02, still=held)


def identified(log, tmp_path, *options, robot=FILE):
    command = ["identify", str(written(log, tmp_path / "log.csv")), "--robot", str(robot), *options]
    result = CliRunner().invoke(app, command)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def friction(text):
    return [float(re.search(rf"coulomb of {name} +(\S+)", text)[1]) for name in ("shoulder", "elbow", "wrist")]


def exchanged(values):
    return values[:, [0, 2, 1]]


LOG = log_of()


@pytest.mark.parametrize(
    ("log", "option"),
    [
        (replace(LOG, tau=-LOG.tau), "--torque-sign -1"),
        (replace(LOG, tau=1e3 * LOG.tau), "--torque-unit mNm"),
        (replace(LOG, tau=0.01 * LOG.tau), "--torque-scale"),
        (replace(LOG, tau=exchanged(LOG.tau)), "--torque-order shoulder,wrist,elbow"),
        (replace(LOG, tau=exchanged(LOG.tau), q=exchanged(LOG.q)), "--joint-order shoulder,wrist,elbow"),
        (replace(LOG, t=1e3 * LOG.t), "--time-unit ms"),
        (replace(LOG, t=1e3 * LOG.t, dq=np.gradient(LOG.q, LOG.t, axis=0)), "--time-unit ms"),
        (replace(LOG, q=np.degrees(LOG.q)), "--position-unit deg"),
        (replace(LOG, dq=np.degrees(np.gradient(LOG.q, LOG.t, axis=0))), "--drop dq"),
        (log_of(gravity=(0.0, 6.9367, -6.9367)), "--gravity"),
    ],
    ids=["sign", "mN m", "motor side", "torque order", "order", "ms", "ms with dq", "degrees", "dq", "mount"],
)
def test_the_option_that_an_error_names_makes_identification_give_the_true_friction(log, option, tmp_path):
    refused = identified(log, tmp_path)
    assert refused.exit_code == 2
    remedy = re.search(rf"`({re.escape(option)}[^`]*)`", refused.output.replace("\n", " "))
    assert remedy, refused.output
    repaired = identified(log, tmp_path, *remedy[1].split())
    assert repaired.exit_code == 0, repaired.output
    # The torque scale is known only as accurately as the masses.
    np.testing.assert_allclose(friction(repaired.output), COULOMB, rtol=0.25 if "scale" in option else 0.06)


@pytest.mark.parametrize("time", ["inf", "-inf", "nan"])
def test_a_time_that_is_not_finite_is_named_with_its_sample(tmp_path, time):
    path = tmp_path / "log.csv"
    rows = [f"{0.001 * k:.3f},{0.1 * k:.1f},{0.2 * k:.1f},1,2" for k in range(299)]
    path.write_text("\n".join(["time,q_1,q_2,tau_1,tau_2", *rows, f"{time},1,1,1,1\n"]))
    robot = Path(__file__).parents[2] / "examples" / "robots" / "two_link.urdf"
    result = CliRunner().invoke(app, ["identify", str(path), "--robot", str(robot)])
    assert result.exit_code == 2
    lines = result.output.strip().splitlines()
    assert len(lines) == 1 and f"the time of sample 300 of `log.csv` is not finite: it is {time}" in lines[0]


def test_velocities_that_are_all_zero_are_ignored(tmp_path):
    plain, zero = (identified(replace(LOG, dq=dq), tmp_path) for dq in (None, 0.0 * LOG.q))
    assert zero.exit_code == 0 and "is 0 throughout" in zero.output
    assert friction(plain.output) == friction(zero.output)


def test_a_log_with_a_vibrating_held_joint_is_identified(tmp_path):
    log = log_of(held=(0,))
    rng = np.random.default_rng(0)
    q = log.q.copy()
    q[:, 0] = 0.5 + 3e-4 * np.sin(2 * np.pi * 2.0 * log.t)
    dq = np.gradient(q, log.t, axis=0)
    dq[:, 0] = np.roll(dq[:, 0], 6) + 0.02 * rng.normal(size=len(q))
    result = identified(replace(log, q=q, dq=dq), tmp_path)
    assert result.exit_code == 0 and "`shoulder`" in result.output
    np.testing.assert_allclose(friction(result.output)[1:], COULOMB[1:], rtol=0.05)


def test_gap_is_reported_with_its_time_and_friction_stays_correct(tmp_path):
    keep = (LOG.t < 5.0) | (LOG.t > 7.0)
    result = identified(LOG.rows(keep), tmp_path)
    assert result.exit_code == 0 and re.search(r"has a gap, the longest of 2.0\d s at 4.99 s", result.output)
    np.testing.assert_allclose(friction(result.output), COULOMB, rtol=0.06)


def with_moment(tmp_path, moment):
    """The arm's file with another moment of inertia of its last link."""
    path = tmp_path / "other.urdf"
    path.write_text(FILE.read_text().replace('izz="0.001"', f'izz="{moment}"'))
    return path


@pytest.mark.filterwarnings("ignore:.*changed to the nearest")
def test_a_physically_impossible_inertia_is_refused_with_the_option_that_accepts_it(tmp_path):
    robot = with_moment(tmp_path, 0.005)
    refused = identified(LOG, tmp_path, robot=robot)
    assert refused.exit_code == 2 and " `--inertias nearest` takes" in refused.output
    assert identified(LOG, tmp_path, "--inertias", "nearest", robot=robot).exit_code == 0


@pytest.mark.filterwarnings("always:.*changed to the nearest")
def test_rounded_inertia_is_read_and_its_warning_names_an_option_of_identify(tmp_path):
    """By 0.25 %: 0.00402 kg m² are 0.00002 more than the sum of the others."""
    robot = with_moment(tmp_path, 0.00402)
    result = identified(LOG, tmp_path, robot=robot)
    assert result.exit_code == 0 and "`--inertias strict` refuses" in result.output
    assert identified(LOG, tmp_path, "--inertias", "strict", robot=robot).exit_code == 2


def test_invalid_identify_options_are_refused_with_the_reason(tmp_path):
    for options, words in (
        (["--torque-sign", "1,-1"], "one for each of the 3 joints"),
        (["--torque-sign", "2"], "must be 1 or -1"),
        (["--torque-scale", "-1"], "must be > 0"),
        (["--torque-unit", "Nmm"], "unknown `torque_unit`"),
        (["--time-unit", "h"], "`time_unit` must be one of"),
        (["--joint-order", "elbow,wrist"], "must name each of the 3 joints once"),
        (["--gravity", "up"], "needs comma-separated numbers"),
        (["--ignore-torque", "hip"], "there is no joint `hip`"),
        (["--locked", "finger"], "needs the form JOINT=POSITION"),
        (["--locked", "finger=0.04", "--locked", "finger=0.02"], "names joint `finger` twice"),
    ):
        refused = identified(LOG, tmp_path, *options)
        assert refused.exit_code == 2 and words in refused.output.replace("\n", " "), refused.output


def test_a_follower_joint_is_refused_with_the_option_that_locks_it(tmp_path):
    text = FILE.read_text()
    follows = re.sub(r'(<joint name="wrist".*?)</joint>', r'\1<mimic joint="elbow"/></joint>', text, flags=re.S)
    assert follows != text
    robot = tmp_path / "arm.urdf"
    robot.write_text(follows)
    with pytest.raises(DefinitionError, match=r"joints that follow others.*--locked wrist=0 holds them"):
        named_robot(str(robot))
    arm, description = named_robot(str(robot), locked={"wrist": 0.0})
    assert (arm.joint_names, description["locked"]) == (("shoulder", "elbow"), {"wrist": 0.0})


def test_joints_locked_by_option_add_to_the_joints_locked_in_the_file(tmp_path):
    (tmp_path / "arm.yaml").write_text(f"robot: {{kind: urdf, file: '{FILE.resolve()}', locked: {{wrist: 0.1}}}}\n")
    arm, _ = named_robot(str(tmp_path / "arm.yaml"), locked={"elbow": 0.2})
    assert arm.joint_names == ("shoulder",)
