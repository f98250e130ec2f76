"""An exported law that follows positions from a host, with the reference filter of the simulation."""

import ctypes

import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export import export_c
from slidax.export.ros2 import export_ros2
from tests.export.exported import COMPILERS, STRICT, compiled, needs_a_compiler, needs_cmake
from tests.export.ros2.test_controller import programs_of

pytestmark = needs_a_compiler
RATE, PER_MESSAGE = 50.0, 20


def message(k):
    """Positions that the host sends at its sample k."""
    t = k / RATE
    return [round(-0.4 + 0.3 * np.sin(2 * t) * min(t, 1.0), 6), round(2.5 - 0.2 * t, 6)]


@pytest.fixture(scope="module")
def scenario():
    text = "time,shoulder,elbow\n" + "\n".join(f"{k / RATE},{','.join(map(str, message(k)))}" for k in range(60))
    stream = {"kind": "streamed", "text": text, "joints": ["shoulder", "elbow"], "rate": RATE}
    stream |= {"bandwidth": 25.0, "velocity": 0.3, "acceleration": 2.0}
    return scenarios.load("example-4.1-1khz", {"trajectory": stream, "start.q": message(0), "simulation.t1": 1.5})


@pytest.fixture(scope="module")
def folder(scenario, tmp_path_factory):
    folder = tmp_path_factory.mktemp("streamed")
    export_c(scenario, folder, name="law", golden=False)
    return folder


def test_the_exported_reference_filter_gives_the_motion_of_the_simulation(scenario, folder):
    law, period = sx.load_export(folder), scenario.period
    wanted = np.array([message(0), [0.0, 0.0], [0.0, 0.0]])
    for k in range(1200):
        newest = message(k // PER_MESSAGE) if k % PER_MESSAGE == 0 else None
        tau, status, wanted = law.follow(k * period, wanted[0], wanted[1], newest)
        if k % 40 == 0:
            now = scenario.trajectory.reference(jnp.asarray(k * period))
            assert wanted == pytest.approx(np.stack([now.q, now.dq, now.ddq]), rel=1e-9, abs=1e-9)
    assert np.isfinite(tau).all() and not law.conditions(status)


def test_a_reset_law_starts_its_reference_at_rest_at_the_measured_position(folder):
    law = sx.load_export(folder)
    for k in range(50):
        law.follow(1e-3 * k, [0.0, 1.0], [0.0, 0.0], [1.0, 2.0])
    law.reset()
    _, _, wanted = law.follow(0.0, [0.3, 1.2], [0.0, 0.0])
    assert wanted.tolist() == [[0.3, 1.2], [0.0, 0.0], [0.0, 0.0]]


def test_follow_is_refused_for_a_law_without_a_streamed_reference(tmp_path):
    export_c(scenarios.load("example-4.1-1khz"), tmp_path, name="law", golden=False)
    with pytest.raises(DefinitionError, match="whose motion is `streamed`"):
        sx.load_export(tmp_path).follow(0.0, [0.0, 0.0], [0.0, 0.0])
    assert not list(tmp_path.glob("*stream*"))


@pytest.mark.parametrize("single", [False, True])
def test_the_reference_filter_in_c_keeps_its_velocity_and_acceleration_limits(scenario, single, tmp_path):
    export_c(scenario, tmp_path, name="law", golden=False, single=single)
    driver = """
    #include "slidax_law_stream.h"
    void many(int count, const REAL *targets, REAL *rows)
    {
        slidax_law_stream stream;
        slidax_law_stream_options options;
        slidax_law_reference reference;
        int k;
        slidax_law_stream_options_default(&options);
        slidax_law_stream_begin(&stream, targets);
        for (k = 0; k < count; ++k) {
            slidax_law_stream_step(&stream, &options, targets + 2 * k, &reference);
            rows[2 * k] = reference.dq_next[0];
            rows[2 * k + 1] = reference.ddq_next[0];
        }
    }
    """.replace("REAL", "float" if single else "double")
    (tmp_path / "driver.c").write_text(driver)
    files = ("slidax_law_stream.c", "driver.c", "-shared", "-fPIC", "-O1", "-o", "stream.so", "-lm")
    compiled(COMPILERS[0], tmp_path, *STRICT, "-Wno-missing-prototypes", *files)
    targets = np.random.default_rng(3).uniform(-2, 2, (40, 2)).repeat(100, axis=0)
    targets = targets.astype(np.float32 if single else np.float64)
    rows = np.zeros_like(targets)
    at = [array.ctypes.data_as(ctypes.c_void_p) for array in (targets, rows)]
    ctypes.CDLL(str(tmp_path / "stream.so")).many(len(targets), *at)
    slack = 1e-5 if single else 1e-12
    assert 0.25 < np.abs(rows[:, 0]).max() <= 0.3 * (1 + slack)
    assert 1.9 < np.abs(rows[:, 1]).max() <= 2.0 * (1 + slack)


@needs_cmake
def test_the_ros2_controller_follows_positions_from_a_topic(scenario, tmp_path):
    changes = {"trajectory.upper": [0.5, 3.0], "scheme": {"name": "computed_torque"}}
    export_ros2(scenario.set(changes), tmp_path, name="law", golden=False)
    lines = [line.split() for line in programs_of(tmp_path)("stream")]
    rows = {words[0]: words[1:] for words in lines}
    start = np.array(message(0))
    assert rows["active"] == ["1"] and " ".join(rows["bad:"]) == "positions rejected: they must be 2 finite numbers"
    numbers = {name: np.array(row[:5], float) for name, row in rows.items() if "phase" in row}
    for name, (ok, error, speed, *_) in numbers.items():
        # The filter's limit is 0.3 rad/s, and the errors stay small, also at a jump.
        assert ok == 1.0 and error < 0.02 and (name == "trajectory" or speed < 0.33), (name, numbers[name])
    assert numbers["silence"][3:] == pytest.approx(np.add(start, [0.396, -0.198]), abs=0.015)
    assert numbers["jump"][3] < numbers["silence"][3] - 0.02
    assert numbers["trajectory"][3:] == pytest.approx(start, abs=0.015)
    assert numbers["beyond"][3] < 0.5 + 1e-3
    assert rows["way"][-1] == "6"
