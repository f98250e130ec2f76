import os
import signal
import subprocess
import threading
import time
from dataclasses import replace
from functools import cache, partial
from importlib import import_module

import numpy as np
import pytest

import slidax as sx
from slidax.analysis import read_saved
from slidax.export.lockstep import Replay, _first, lockstep, replay, write_lockstep_log
from slidax.export.loop_plans import arm_plan, law_plan
from slidax.export.real_time_loop import run_loop
from slidax.export.status import MISSED_PERIOD
from slidax.identify import read_log
from slidax.runtime import ArmSide, LawSide
from slidax.runtime.logs import read_mcap
from slidax.runtime.processes import run_law
from slidax.scenarios import portable_text
from slidax.simulation import columns_of
from tests.cli.commands import answer_of, in_process

pytest.importorskip("llvmlite")
NAME, T1 = "example-4.1-1khz", 0.6


@cache
def scenario(**changes):
    return sx.scenarios.load(NAME, {"simulation.t1": T1, **changes})


PLANS = {}


@pytest.fixture(autouse=True, scope="module")
def _plans_are_made_once():
    """Tracing a law takes seconds, and all these tests use the same law."""
    patch = pytest.MonkeyPatch()
    for module in ("lockstep", "real_time_loop"):
        user = import_module(f"slidax.export.{module}")
        for name, make in (("law_plan", law_plan), ("arm_plan", arm_plan)):
            if hasattr(user, name):
                patch.setattr(user, name, partial(_made_once, make))
    yield
    patch.undo()


def _made_once(make, scenario, **how):
    key = make, portable_text(scenario.description)[0], *how.items()
    if key not in PLANS:
        PLANS[key] = make(scenario, **how)
    return PLANS[key]


@cache
def simulated():
    return scenario().simulate(log_every=1)


@cache
def stepped():
    return lockstep(scenario(), len(simulated().log.t), transport=1)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    pytest.importorskip("foxglove")
    pytest.importorskip("mcap")
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    write_lockstep_log(scenario(), stepped(), path)
    return path


@pytest.mark.parametrize("transport", [pytest.param(0, marks=pytest.mark.full), 1])
def test_a_lockstep_loop_without_delays_equals_the_simulated_run(transport):
    run, result = simulated(), stepped() if transport else lockstep(scenario(), len(simulated().log.t))
    np.testing.assert_allclose(result.arm["true_q"], run.log.state.q, atol=1e-12)
    np.testing.assert_allclose(result.arm["set_tau"], run.log.tau, atol=1e-8)
    np.testing.assert_allclose(result.arm["true_e"], run.log.e, atol=1e-12)
    np.testing.assert_allclose(result.law["lower"], run.log.envelope.lower, atol=1e-12)
    np.testing.assert_allclose(result.law["signal:s"], run.log.signals["s"], atol=1e-8)
    assert not (result.law["status"] & MISSED_PERIOD.bit).any()


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (NAME, {"sensor.delay": 2}),
        (NAME, {"sensor.delay": 1.5}),
        (NAME, {"sensor.loss": {"probability": 0.1}}),
        (NAME, {"actuator.dead_time": 1}),
        ("panda-payload", {"simulation.plant": "mujoco", "simulation.t1": 0.3}),
    ],
    ids=["later", "between samples", "lossy", "dead time", "mujoco"],
)
def test_the_lockstep_loop_equals_the_simulated_run_with_delays_losses_and_mujoco(name, changes):
    if "simulation.plant" in changes:
        pytest.importorskip("mujoco")
    item = sx.scenarios.load(name, {"simulation.t1": T1, **changes})
    run = item.simulate(log_every=1)
    result = lockstep(item, len(run.log.t), transport=1)
    np.testing.assert_allclose(result.arm["true_q"], run.log.state.q, atol=1e-11)
    np.testing.assert_allclose(result.arm["set_tau"], run.log.tau, atol=1e-8)
    assert (len(result.law["k"]) < len(run.log.t)) == (changes == {"sensor.loss": {"probability": 0.1}})


def driven(late):
    of_law, of_arm = _made_once(law_plan, scenario()), _made_once(arm_plan, scenario(), transport=1)
    law, arm = LawSide(of_law.plan, 1e-3), ArmSide(of_arm.plan, None, of_arm.substeps)
    rows, taus, applied = [], [], -1
    for k in range(400):
        law.measured[:] = arm.measured
        assert law.answer(k, applied)
        rows.append(law.row.copy())
        arm.tau[:] = law.tau.view(float)
        if k not in late:
            applied = k
        else:
            # The torque that the drives hold.
            arm.tau[:] = taus[-1]
        arm.set(k, k not in late)
        arm.measure(k)
        taus.append(arm.arena.view("set_tau").copy())
        arm.move()
    return of_law.columns(np.stack(rows)), np.stack(taus)


def test_a_delayed_command_counts_as_a_lost_sample_for_the_law():
    late = [50, 51, 52, 120, 200]
    law, taus = driven(set(late))
    outages = [{"start": k * 1e-3, "samples": 1} for k in late]
    lost = sx.scenarios.load(NAME, {"simulation.t1": T1, "sensor.loss": {"outages": outages}}).simulate(log_every=1)
    np.testing.assert_allclose(taus, lost.log.tau[: len(taus)], atol=1e-8)
    missed = np.nonzero(law["status"] & MISSED_PERIOD.bit)[0].tolist()
    assert missed == [51, 52, 53, 121, 201]
    assert law["basis"][[50, 51, 52, 53, 54]].tolist() == [49, 49, 49, 49, 53]


def test_replay_of_a_log_is_bitwise_equal_and_detects_a_changed_torque(log):
    message = answer_of("replay", str(log))
    assert message["first"] is None and message["same"] == message["answers"] == len(simulated().log.t)
    # The last digit of one torque.
    read = read_mcap(log)
    tau = read.law["tau"].copy()
    tau[123, 1] = np.nextafter(tau[123, 1], np.inf)
    other = replay(replace(read, law={**read.law, "tau": tau}))
    assert (other.first.tick, other.first.joint, other.same) == (123, 1, message["same"] - 1)
    assert 0 < other.largest < 1e-13 and "at tick 123, t = 0.123 s" in other.sentence()


def test_a_difference_of_a_replay_names_the_torque_also_if_only_the_sign_of_zero_differs():
    status = np.array([1, 1])
    bits = {"k": np.array([0, 1]), "t": np.array([0.0, 1e-3]), "status": status}
    logged = {**bits, "tau": np.array([[np.inf, 0.0], [np.inf, 1.0]])}
    for row, changed, words in ((0, -0.0, "in the sign of zero"), (1, 1.5, "0.5 off")):
        tau = logged["tau"].copy()
        tau[row, 1] = changed
        first = _first(logged, {"tau": tau, "status": status}, row)
        assert first.joint == 1
        sentence = Replay(2, 1, first, 0.0, ("shoulder", "elbow"), ("HELD",), 0).sentence()
        assert f"elbow was commanded {logged['tau'][row, 1]}, and is now {changed}, " in sentence and words in sentence
    first = _first(logged, {"tau": logged["tau"], "status": np.array([0, 1])}, 0)
    assert first.joint is None and first.status == (1, 0)


@pytest.mark.full
def test_replay_of_a_changed_measurement_differs_from_its_tick_on(log):
    read = read_mcap(log)
    q = read.law["q"].copy()
    q[200, 0] += 1e-9
    other = replay(replace(read, law={**read.law, "q": q}))
    assert other.first.tick == 200 and other.same < 210


@pytest.mark.full
def test_replay_does_not_compare_answers_after_a_lost_answer(log):
    read = read_mcap(log)
    kept = np.arange(len(read.law["k"])) != 300
    result = replay(replace(read, law={name: column[kept] for name, column in read.law.items()}))
    assert (result.same, result.first) == (300, None) and result.unknown == kept.sum() - 300


def test_explain_and_read_log_give_the_signals_of_the_run_from_a_loop_log(log):
    done = in_process("explain", str(log), code=0)
    assert "Nothing to explain" in done.output
    _, columns, each = read_saved(log)
    assert each
    for name, (values, _) in columns_of(simulated(), ["_1", "_2"]).items():
        np.testing.assert_allclose(columns[name], values, atol=1e-8, err_msg=name)
    read = read_log(log, simulated().joint_names)
    np.testing.assert_allclose(read.t, simulated().log.t, atol=1e-9)
    np.testing.assert_allclose(read.q[1:], simulated().log.state.q[:-1], atol=1e-12)
    np.testing.assert_allclose(read.tau[1:], simulated().log.tau[:-1], atol=1e-8)


def test_slidax_run_logs_the_measurements_and_torques_that_the_step_reads(tmp_path):
    pytest.importorskip("foxglove")
    in_process("run", NAME, "--set", f"simulation.t1={T1}", "--out", str(tmp_path / "x.mcap"), code=0)
    read = read_mcap(tmp_path / "x.mcap")
    # A measurement is one period old, and includes the torque that the drives applied at that time.
    np.testing.assert_allclose(read.law["q"][1:], read.arm["true_q"][:-1], atol=1e-12)
    np.testing.assert_array_equal(read.law["effort"][1:], read.arm["set_tau"][:-1])
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]


def test_a_real_time_loop_logs_each_tick_and_its_replay_is_bitwise_equal(tmp_path):
    pytest.importorskip("foxglove")
    log, picture = tmp_path / "log.mcap", tmp_path / "latency.svg"
    where = ("--out", str(log), "--histogram", str(picture))
    message = answer_of("loop", NAME, "--time", str(T1), "--patience", "500", *where)
    ticks = round(T1 / 1e-3) + 1
    assert (message["ticks"], message["ended"], message["envelope"]["outside"]) == (ticks, "done", 0)
    assert message["answers"] == ticks - message["missed"]["skipped"]
    assert message["log"].pop("recorder_us") > 0.0
    assert message["log"] == {"bytes": log.stat().st_size, "rows_lost": 0}
    titles = {"wake-up, law", "wake-up, arm", "step", "measurement to command", "row into the ring"}
    assert set(message["latency_us"]) == titles
    for shares in message["latency_us"].values():
        assert 0 <= shares["p50"] <= shares["p99"] <= shares["p99.9"] <= shares["max"]
    assert picture.read_text().count("<path") > 10
    read = read_mcap(log)
    assert read.complete and read.arm["true_k"].tolist() == list(range(ticks))
    again = replay(read)
    assert (again.first, again.unknown) == (None, 0)


def test_arm_brakes_when_the_law_requests_a_stop():
    """With this speed limit, the gate rejects every motion of the arm as a sensor fault."""
    done = in_process(
        "loop", NAME, "--set", "scheme.sampled_data.gate.speed=0.02", "--time", "20", "--patience", "500", code=3
    )
    assert "the arm braked, as the law asked for a stop (STOP_REQUESTED)" in " ".join(done.output.split())


@pytest.mark.full
def test_the_law_process_ends_when_the_arm_process_is_killed(tmp_path):
    killed = threading.Thread(target=_kill, args=("arm",))
    killed.start()
    done = run_loop(scenario(**{"simulation.t1": 20.0}), patience=200)
    killed.join()
    assert not done.good and done.arm is None and done.law.reason == "no measurement"
    assert 100 < done.answers < 19_000


@pytest.mark.full
def test_the_arm_brakes_and_logs_it_when_the_law_process_is_killed(tmp_path):
    pytest.importorskip("foxglove")
    killed = threading.Thread(target=_kill, args=("law",))
    killed.start()
    done = run_loop(scenario(**{"simulation.t1": 20.0}), log=tmp_path / "log.mcap", patience=200)
    killed.join()
    assert not done.good and done.law is None and "killed" in done.reason
    read = read_mcap(tmp_path / "log.mcap")
    braking = read.arm["braking"].astype(bool)
    assert braking.any() and read.arm["missing"][braking].min() == 201
    # The disturbance continues to act.
    assert np.abs(read.arm["true_dq"][-1]).max() < 0.02 and replay(read).first is None


def _kill(side):
    for _ in range(600):
        time.sleep(0.1)
        result = subprocess.run(
            ["ps", "--ppid", str(os.getpid()), "-o", "pid=,args="], capture_output=True, text=True, check=False
        ).stdout
        processes = [line.split()[0] for line in result.splitlines() if f"{run_law.__module__} {side} " in line]
        if processes:
            time.sleep(2.0)
            os.kill(int(processes[0]), signal.SIGKILL)
            return
