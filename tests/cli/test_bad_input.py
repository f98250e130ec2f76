import pytest

from .commands import assert_one_line, own_process

CASES = {
    "scheme.performance.deadline=[5,0]": ["FixedTime.deadline", "> 0", "(eq. 20)", "got 0", "joint 2"],
    "scheme.performance.initial=[0.5,0.6]": ["inside the envelope", "(eq. 12)", "got e(0) = -0.6", "joint 1"],
    "scheme.performance.initial=[1,1,1]": ["FixedTime.final", "2 entries", "`initial` has 3"],
    "scheme.surface.k1=[0.2,0.2,0.2]": ["SmoothFixedTime", "k1", "shape [3]", "2 joints"],
    "disturbance.terms.0.amplitude=[1,1,1]": ["terms.0", "Harmonic.frequency", "2 entries", "`amplitude` has 3"],
    "disturbance.terms.1.amplitude=[1,1,1]": ["disturbance", "amplitude", "shape [3]", "2 joints"],
    "trajectory.offset=[1]": ["trajectory", "amplitudes", "one column per joint"],
    "start.q=[1]": ["start.q", "2 joints", "got 1"],
    "robot.plant.masses=[1]": ["robot.plant", "TwoLink.masses", "2 numbers"],
    "simulation.period=-1e-4": ["simulation.period", "> 0", "-0.0001"],
    "simulation.period=3e-4": ["`t1`", "whole number of periods"],
    "simulation.substeps=0": ["simulation.substeps", ">= 1", "got 0"],
    "simulation.substeps=2": ["substeps`", "1 in continuous mode", "got 2"],
    "simulation.mode=hold": ["simulation.mode", "`hold`", "did you mean `held`?"],
    "simulation.engine=fast": ["simulation.engine", "`fast`", "`auto`, `native`, `xla`"],
    "scheme.name=cftsmpc": ["scheme.name", "`cftsmpc`", "did you mean `cftsmppc`?"],
    "scheme.surfce.k1=1": ["scheme", "unknown key `surfce`", "did you mean `surface`?"],
    "simulaton.period=1": ["unknown key `simulaton`", "did you mean `simulation`?"],
    "trajectory.kind=sinusoidal": ["trajectory.kind", "did you mean `sinusoid`?"],
    "scheme.overshoot=wide": ["scheme.transformation.overshoot", "number or a list of numbers", "'wide'"],
    "scheme.bound=3": ["scheme.bound", "got 3"],
    "disturbance.terms.9.start=1": ["disturbance.terms", "list of 2"],
    "scheme.overshoot=.nan": ["overshoot", "got nan"],
    "period": ["--set period", "PATH=VALUE"],
    "scheme.overshoot=[1,": ["not valid YAML"],
}

AT_1_KHZ = {
    "sensor.delay=-1": ["sensor.delay", "must be >= 0", "got -1"],
    "sensor.jitter=-0.5": ["sensor.jitter", "must be >= 0", "got -0.5"],
    "sensor.resolution=[1e-5,1e-5,1e-5]": ["sensor.resolution", "2 joints", "got 3"],
    "sensor.resolution=-1e-5": ["sensor: ", "Encoders.resolution", ">= 0", "got -1e-05"],
    "sensor.position_noise=[0,-1]": ["sensor: ", "Encoders.position_noise", ">= 0", "got -1", "joint 2"],
    "sensor.velocity_noise=-1": ["sensor: ", "Encoders.velocity_noise", ">= 0", "got -1"],
    "sensor.velocity=guessed": ["sensor.velocity", "`guessed`", "`measured`, `differenced`"],
    "sensor={velocity: differenced, velocity_noise: 1e-3}": ["sensor.velocity_noise", "velocity sensor", "got 0.001"],
    "sensor={velocity: differenced, cutoff: 0}": ["sensor: ", "DifferencedEncoders.cutoff", "> 0", "got 0"],
    "sensor.loss.probability=2": ["sensor.loss: ", "Lossy.probability", "[0, 1]", "got 2"],
    "sensor.loss.outages=[{start: 1, samples: -2}]": ["sensor.loss.outages.0.samples", ">= 0", "got -2"],
    "sensor.loss.outages=[{start: -1, samples: 2}]": ["sensor.loss.outages.0.start", ">= 0", "got -1"],
    "sensor.loss.outages=[{start: 1}]": ["sensor.loss.outages.0.samples", "is missing"],
    "sensor.seed=-1": ["sensor.seed", ">= 0", "got -1"],
    "sensor.seed=99999999999999999999": ["sensor.seed", "must be <", "got 99999999999999999999"],
    "sensr.delay=1": ["unknown key `sensr`", "did you mean `sensor`?"],
    "actuator.torque=0": ["actuator: ", "TorqueLimits.torque", "> 0", "got 0"],
    "actuator.torque=[60,60,60]": ["actuator.torque", "2 joints", "got 3"],
    "actuator.torque=[60,-1]": ["actuator: ", "TorqueLimits.torque", "got -1", "joint 2"],
    "actuator.rate=-1": ["actuator: ", "TorqueLimits.rate", "> 0", "got -1"],
    "actuator.time_constant=-1": ["actuator: ", "Actuator.time_constant", ">= 0 s", "got -1"],
    "actuator.time_constant=[0,0,0]": ["actuator.time_constant", "2 joints", "got 3"],
    "actuator.dead_time=-1": ["actuator.dead_time", ">= 0", "got -1"],
    "scheme.sampled_data.horizon=5e-4": ["scheme.sampled_data: ", "`SampledData.horizon`", "0.001 s", "got 0.0005"],
    "scheme.sampled_data.horizon=-1": ["scheme.sampled_data.horizon", "> 0", "got -1"],
    "scheme.sampled_data.horizn=1": ["scheme.sampled_data", "unknown key `horizn`", "did you mean `horizon`?"],
    "scheme.sampled_data.slopes=maybe": ["scheme.sampled_data.slopes", "got 'maybe'"],
    "scheme.sampled_data.estimator={kind: kalmann}": ["sampled_data.estimator.kind", "did you mean `kalman`?"],
    "scheme.sampled_data.estimator={kind: kalman, torque_density: -1}": ["sampled_data.estimator: ", "> 0", "got -1"],
    "scheme.sampled_data.estimator={kind: kalman, variance: [1,1,1]}": ["estimator.variance", "2 joints", "got 3"],
    "scheme.sampled_data.estimator={kind: measured, gain: 2}": ["estimator: ", "Measured.gain", "[0, 1]", "got 2"],
    "scheme.sampled_data.estimator={kind: measured, gain: [0,0,0]}": ["estimator.gain", "2 joints", "got 3"],
    "scheme.sampled_data.estimator={kind: measured, trend: 9}": ["Measured.trend", "[0, `4 - 2 * gain` = ", "got 9"],
    "scheme.sampled_data.estimator={kind: filtered_difference}": ["sampled_data.estimator.cutoff", "is missing"],
    "scheme.sampled_data.estimator={kind: robust_differentiator, lipschitz: 0}": ["lipschitz", "> 0", "got 0"],
    "scheme.sampled_data.recovery.room=1": ["sampled_data.recovery: ", "Recovery.room", "> 1", "got 1"],
    "scheme.sampled_data.recovery.share=2": ["sampled_data.recovery: ", "Recovery.share", "(0, 1)", "got 2"],
    "scheme.sampled_data.recovery.deadline=0": ["sampled_data.recovery: ", "Recovery.deadline", "> 0 s", "got 0"],
    "scheme.reaching.gain=[[1,0],[0,1]]": ["scheme.sampled_data: ", "FixedTimeReaching.gain", "diagonal", "[2, 2]"],
    "simulation.outside=rescue": ["simulation.outside", "`rescue`", "did you mean `recover`?"],
    "simulation={mode: continuous, period: 1e-3, t1: 1}": ["sampled-data law needs samples", "held mode"],
    # odd paths and odd values
    ".scale=1": ["is not a path"],
    "disturbance.=1": ["is not a path"],
    "disturbance..scale=1": ["`disturbance..scale` is not a path"],
    "..=1": ["is not a path"],
    "trajectory.offset.x=1": ["list of 2", "`x`"],
    "trajectory.offset.-1=1": ["list of 2"],
    "trajectory.offset.²=1": ["list of 2"],
    f"trajectory.offset.{'9' * 5000}=1": ["list of 2"],
    "title.0=1": ["`title` is a single value"],
    "größe=1": ["unknown key `größe`"],
    "a\nb=1": ["unknown key `a\\nb`"],
    f"{'k' * 10000}=1": ["unknown key"],
    "robot=&a [*a]": ["contains it"],
    "title=" + "[" * 5000: ["levels"],
    f"title={'1' * 5000}": ["not valid YAML"],
    "title=!!float ''": ["not valid YAML"],
    "title=2001-13-45": ["not valid YAML"],
    "start.q=!!set {a}": ["start.q"],
    f"scheme.overshoot={[0.5] * 1000}": ["overshoot"],
    "simulation.period=1e-300": ["periods"],
    "simulation.t1=1e12": ["at most 1e+09 periods"],
    "simulation.substeps=1000000000000": ["simulation.substeps", "<= 10000"],
    "simulation.log_every=1000000000000": ["simulation.log_every", "<= 1e+09"],
    "sensor.delay=1e12": ["sensor.delay", "<= 100"],
    "sensor.jitter=1e12": ["sensor.jitter", "<= 100"],
    "actuator.dead_time=1e12": ["actuator.dead_time", "<= 100"],
    "sensor.loss={outages: [{start: 0, samples: 1000000000000}]}": ["outages.0.samples", "<= 1e+09"],
    "trajectory={kind: minimum_jerk, times: [0, 1], waypoints: [[-0.4, 2.5], [1]]}": ["waypoints.1", "got 1"],
    "trajectory={kind: trapezoidal, waypoints: [[-0.4, 2.5], []], velocity: 1, acceleration: 1}": ["waypoints.1"],
    "trajectory={kind: quintic, waypoints: [[1], [1, 2]], velocity: 1, acceleration: 1}": ["waypoints.0"],
}


@pytest.mark.parametrize(
    ("scenario", "change", "words"),
    [
        *(pytest.param("example-4.1", *case, id=case[0][:60]) for case in CASES.items()),
        *(pytest.param("example-4.1-1khz", *case, id=case[0][:60]) for case in AT_1_KHZ.items()),
    ],
)
def test_invalid_setting_is_reported_in_one_line_with_field_rule_and_value(scenario, change, words):
    assert_one_line(words, "run", scenario, "--set", change, "--json")


COMPARE = ("compare", "example-4.1", "--json")
FAST = ("--set", "scheme={name: computed_torque}")
REQUESTS = [
    (("run", "example-4.3"), ["unknown scenario `example-4.3`", "did you mean `example-4."]),
    (("run", "nowhere.yaml"), ["cannot read", "nowhere.yaml", "No such file"]),
    (("run", "example-4.1", "--out", "x.mcap"), ["simulation.mode=held"]),
    (
        (
            "run",
            "example-4.1-1khz",
            "--set",
            "transmission={elasticity: {stiffness: 1e4, damping: 5}}",
            "--out",
            "x.mcap",
        ),
        ["cannot be simulated sample by sample", "leave `transmission` out"],
    ),
    (("run", "example-4.1", "--set", "scheme.sampled_data={}"), ["sampled-data law needs samples", "held mode"]),
    (
        (
            *("run", "example-4.1-1khz", "--set", "scheme.name=computed_torque", "--set"),
            "scheme.sampled_data.horizon=0.02",
        ),
        ["scheme.sampled_data: ", "`ComputedTorque` does not plan over a horizon"],
    ),
    ((*COMPARE, "--schemes", "cftsmppc,ftsmcc"), ["unknown `ftsmcc`", "did you mean `ftsmc`?"]),
    ((*COMPARE, "--schemes", ","), ["--schemes", "is empty"]),
    ((*COMPARE, "--set", "scheme.name=ftsmc"), ["`--schemes`"]),
    (
        (*COMPARE, "--schemes", "cftsmppc,ftsmc", "--set", "scheme.overshoot=0.5"),
        ["with the scheme `ftsmc`", "performance: is missing"],
    ),
    ((*COMPARE, "--set", "simulaton.t1=1"), ["did you mean `simulation`?"]),
    (("certify", "example-4.2", "--set", "scheme.surface.p=1"), ["eq. 29"]),
    (("certify", "nothing"), ["unknown scenario `nothing`"]),
    (("linear", "example-4.1-1khz", "--at", "99"), ["`at` must be from 0.001 to 10 s; got 99"]),
    (("linear", "example-4.1-1khz", "--at", "nan"), ["`at` must be from"]),
    (("linear", "no-such"), ["unknown scenario `no-such`"]),
    (("explain", "."), ["slidax run SCENARIO --out FOLDER"]),
    (("replay", "no.mcap"), ["cannot read the file"]),
    (("new", "--robot", "pnada"), ["did you mean `panda`"]),
    (("study", "nothing.yaml"), ["cannot read"]),
    (("benchmark", "--tasks", "scara-slwo", "--out", "out"), ["scara-slow"]),
    (("benchmark", "--schemes", "cftsmpc", "--out", "out"), ["cftsmppc"]),
    (("benchmark", "--scheme", "no.such.module:Law", "--out", "out"), ["cannot import"]),
    (("benchmark", "--form", "sampled", "--out", "out"), ["sampled-data"]),
    (("loop", "example-4.1-1khz", "--set", "sensor.delay=0"), ["--set sensor.delay=1"]),
    (("loop", "example-4.1-1khz", "--arm", "mujoco"), ["MuJoCo needs an articulated arm"]),
    (("export", "c", "example-4.1", "--out", ".", "--name", "4x"), ["--name"]),
    (("export", "c", "example-9", "--out", "."), ["unknown scenario"]),
    (("export", "c", "example-4.1", "--out", ".", "--set", "scheme.overshoot=2"), ["overshoot"]),
    (("export", "fmu", "example-4.1", "--out", "law.fmu", "--fmi", "4"), ["must be 3 or 2"]),
    (("export", "franka", "example-4.1-1khz", "--out", "law", *FAST), ["7 joints"]),
    (
        ("export", "franka", "panda-payload", "--out", "law", *FAST, "--set", "simulation.period=2e-3"),
        ["simulation.period=1e-3"],
    ),
    (("export", "ur", "example-4.1-1khz", "--out", "law", *FAST), ["6 joints"]),
    (
        ("export", "ur", "ur5e-payload", "--out", "law", *FAST, "--set", "simulation.period=1e-3"),
        ["simulation.period=2e-3"],
    ),
    (("export", "ros2", "example-4.1-1khz", "--out", "law", *FAST, "--gravity", "robot"), ["articulated"]),
    (("export", "ros2", "example-9", "--out", "law", *FAST), ["unknown scenario"]),
    (("export", "web", "--with", "pid", "--out", "site"), ["name one"]),
    (("export", "web", "--set", "disturbance.scale=0", "--out", "site"), ["name one"]),
    (("export", "web", "no-such", "--out", "site"), ["unknown scenario `no-such`"]),
    (("export", "web", "example-4.1-1khz", "--with", "computed_torqe", "--out", "site"), ["`computed_torque`"]),
    (("export", "web", "example-4.1-1khz", "--set", "scheme.surface.k1=-1", "--out", "site"), ["must be > 0"]),
]


@pytest.mark.parametrize(("arguments", "words"), REQUESTS, ids=lambda value: " ".join(value)[:80])
def test_invalid_command_is_refused_in_one_line_and_writes_nothing(arguments, words, tmp_path, monkeypatch):
    if "mujoco" in arguments:
        pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    assert_one_line(words, *arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", ".", "..", "a.b.c", "ü\n", "x" * 10000, "\x1b[31m", "schemes."])
def test_unusual_part_names_are_refused_in_one_line(name):
    assert_one_line(["there is no part"], "list", name)


LAUGHS = "a: &a0 [1, 1]\n" + "".join(f"b{k}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(12))

TEXTS = {
    "empty": (b"", "a scenario must be a mapping"),
    "binary": (b"\x00\x01\xff\xfe", "not UTF-8"),
    "zeros": (b"\x00" * 100, "not valid YAML"),
    "list": (b"[1, 2]", "a scenario must be a mapping"),
    "laughs": (LAUGHS.encode(), "with expanded aliases"),
    "itself": (b"&a {title: *a}", "contains it"),
    "deep": (b"title: " + b"[" * 60 + b"]" * 60, "levels"),
    "bottomless": (b"title: " + b"[" * 3000, "levels"),
    "long": (b"title: [" + b"1," * 1_000_000 + b"1]", "characters"),
    "twice": (b"title: a\ntitle: b", "not valid YAML"),
    "keys": (b"{1: 2, null: 3, [1]: 4}", "a key must be text; got `1`"),
    "tag": (b"!!python/object:os.system x", "not valid YAML"),
}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.full] if kind == "bottomless" else []) for kind in TEXTS]
)
def test_file_that_is_no_scenario_is_refused_in_one_line(kind, tmp_path):
    text, words = TEXTS[kind]
    path = tmp_path / "odd.yaml"
    path.write_bytes(text)
    assert_one_line([words], "run", str(path))
    if kind == "list":
        assert_one_line([words], "compare", str(path))
        assert_one_line([words], "export", "c", str(path), "--out", str(tmp_path / "law"))


def test_table_with_an_open_quotation_mark_is_named_with_its_line(tmp_path):
    path = tmp_path / "quote.csv"
    path.write_text('time,"a\n0,0\n1,1\n')
    words = ["quote.csv", "line 1", "a quotation mark is not closed"]
    assert_one_line(words, "run", "example-4.1", "--set", f"trajectory={{kind: csv, file: '{path}'}}")


def test_folder_and_broken_link_are_refused_in_one_line(tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    (tmp_path / "gone.yaml").symlink_to(tmp_path / "nowhere")
    for name in ("folder.yaml", "loop.yaml", "gone.yaml"):
        assert_one_line(["cannot read", name], "run", str(tmp_path / name))


@pytest.mark.parametrize(
    "arguments",
    [("run", "example-4.1-1khz", "--set", "simulation.t1=0.01"), ("export", "c", "example-4.1-1khz"), ("demo",)],
    ids=lambda words: " ".join(words[:2]),
)
def test_file_in_place_of_a_folder_is_refused_in_one_line(arguments, tmp_path):
    (tmp_path / "taken").write_text("a file")
    assert_one_line(["cannot write", "taken"], *arguments, "--out", str(tmp_path / "taken"))


def test_crash_of_a_foreign_library_is_reported_in_one_line(monkeypatch, tmp_path):
    class PanicException(BaseException):
        """An exception like that of PyO3."""

    def panic(*_):
        raise PanicException("called `Result::unwrap()` on an `Err` value\nnote: run with RUST_BACKTRACE=1")

    monkeypatch.setattr("slidax.runtime.logs.mcap_files.read_mcap", panic)
    assert_one_line(["a library crashed (called `Result::unwrap()`"], "replay", str(tmp_path / "x.mcap"))


def test_no_traceback_reaches_the_user():
    result = own_process("run", "example-4.1", "--set", "scheme.overshoot=2")
    assert result.returncode == 2
    assert " ".join(result.stderr.split()) == (
        "slidax: scheme.transformation: `PrescribedPerformance.overshoot` must be in (0, 1) (eq. 13); got 2"
    )
