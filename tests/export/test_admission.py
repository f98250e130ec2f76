"""Admission of motions in C decides as in Python."""

import ctypes
from typing import Any

import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import admit, certified_law
from slidax.core.errors import DefinitionError
from slidax.export.admission import PIECES, POWERS, _groups, export_admission
from slidax.export.c_project import project
from slidax.motions.waypoints import MinimumJerk
from tests.certify.motion.test_hand_over import PANDA, SCHEMES
from tests.certify.motion.test_paper_arms import NEAR
from tests.certify.motion.test_parameter_sets import ROTORS, SETS
from tests.cli.commands import in_process
from tests.export.exported import COMPILERS, compiled, needs_a_compiler

pytestmark = needs_a_compiler

REASONS = {1: "error", 2: "position", 3: "speed", 4: "torque", 5: "torque step", 9: "planned torque step"}


class CompiledAdmission:
    """The admission function of an exported law, called through ctypes."""

    def __init__(self, scenario: Any, folder: Any, *optimised: str) -> None:
        export_admission(scenario, project(scenario, name="law", with_golden=False), folder)
        self.joints = n = scenario.controller.joints
        compiled(
            COMPILERS[0],
            folder,
            *(optimised or ["-O1"]),
            "-shared",
            "-fPIC",
            "slidax_law_admission.c",
            "-o",
            "a.so",
            "-lm",
        )
        library = ctypes.CDLL(str(folder / "a.so"))

        class Motion(ctypes.Structure):
            _fields_ = (
                ("pieces", ctypes.c_int),
                ("powers", ctypes.c_int),
                ("times", ctypes.c_double * (PIECES + 1)),
                ("coefficients", ctypes.c_double * POWERS * n * PIECES),
            )

        class Options(ctypes.Structure):
            _fields_ = (
                ("allowed", ctypes.c_double * n),
                ("assume_steps", ctypes.c_int),
                ("slow_down", ctypes.c_int),
            )

        class Answer(ctypes.Structure):
            _fields_ = (
                ("reason", ctypes.c_int),
                ("joint", ctypes.c_int),
                ("time", ctypes.c_double),
                ("value", ctypes.c_double),
                ("limit", ctypes.c_double),
                ("slow_down", ctypes.c_double),
                ("bounded", ctypes.c_int),
                ("error", ctypes.c_double * n),
                ("torque", ctypes.c_double * n),
                ("torque_step", ctypes.c_double * n),
            )

        self.motion, self.options = Motion, Options
        library.slidax_law_admission_work_size.restype = ctypes.c_ulong
        self.work = ctypes.create_string_buffer(library.slidax_law_admission_work_size())
        self.function = library.slidax_law_admit_motion
        self.function.restype = Answer
        self._slow = library.slidax_law_slow_motion

    def plan(self, motion: Any) -> Any:
        """The motion as C takes it."""
        coefficients, times = np.asarray(motion.coefficients), np.asarray(motion.times)
        plan = self.motion()
        plan.powers, plan.pieces = coefficients.shape[:2]
        plan.times[: len(times)] = times.tolist()
        np.ctypeslib.as_array(plan.coefficients)[: plan.pieces, :, : plan.powers] = coefficients.transpose(1, 2, 0)
        return plan

    def __call__(self, motion: Any, allowed: float = 0.0, assume_steps: bool = False, slow_down: bool = False) -> Any:
        return self.decide(self.plan(motion), allowed, assume_steps, slow_down)

    def slow(self, plan: Any, factor: float) -> None:
        """Multiply a motion's times."""
        self._slow(ctypes.byref(plan), ctypes.c_double(factor))

    def decide(self, plan: Any, allowed: float, assume_steps: bool, slow_down: bool) -> Any:
        """The answer for a motion in C's form."""
        options = self.options()
        options.allowed[:] = [allowed] * self.joints
        options.assume_steps, options.slow_down = int(assume_steps), int(slow_down)
        return self.function(ctypes.byref(plan), ctypes.byref(options), self.work)


def random_motions(law: Any, count: int, seed: int = 0) -> list[MinimumJerk]:
    """Random motions between two postures, from slow to too fast."""
    rng, limits = np.random.default_rng(seed), law.arm.limits
    low, high = (np.clip(np.asarray(limit, float), -2.0, 2.0) for limit in (limits.lower, limits.upper))
    speed = np.clip(np.asarray(limits.velocity, float), 0.0, 2.0)
    motions = []
    for _ in range(count):
        share = rng.uniform(0.1, 1.3)
        # The postures are near each other, so that the motion is short.
        points = rng.uniform(low, high) + 0.3 * (high - low) * rng.uniform(-0.5, 0.5, (2, len(low)))
        points = 0.5 * (low + high) + 0.6 * (points - 0.5 * (low + high))
        motions.append(MinimumJerk.within(points, velocity=share * speed, acceleration=4.0 * share))
    return motions


def assert_same_decisions(decide: CompiledAdmission, law: Any, count: int, allowed: float) -> None:
    answers = []
    for motion in random_motions(law, count):
        expected = admit(law, motion, allowed=allowed, assume_steps=True, slow_down=False)
        answer = decide(motion, allowed, assume_steps=True)
        assert (answer.reason == 0) == expected.admitted
        assert answer.bounded == ("error" in expected.verdict.bound)
        if answer.bounded:
            np.testing.assert_allclose(answer.error, expected.verdict.bound["error"], rtol=2e-3)
        if "torque" in expected.verdict.bound:
            # C adds the disturbances before taking the larger of two cells, which gives a slightly smaller value.
            np.testing.assert_allclose(answer.torque, expected.verdict.bound["torque"], rtol=5e-3)
            np.testing.assert_allclose(answer.torque_step, expected.verdict.bound["torque_step"], rtol=5e-3)
        if expected.limit is not None and expected.limit.what != "torque step":
            assert REASONS[answer.reason] == expected.limit.what
            assert law.arm.joint_names[answer.joint] == expected.limit.joint
        answers.append(answer)
    reasons = {answer.reason for answer in answers}
    print(f"{count} motions, {sum(answer.reason == 0 for answer in answers)} admitted, reasons {sorted(reasons)}")
    assert 0 in reasons and len(reasons) > 1


CASES: dict[str, tuple[dict[str, Any], float]] = {
    "band": ({}, 1.5e-3),
    "numbers": ({"uncertainty": SETS["each body and rotor"], **ROTORS}, 1.5e-3),
    "sliding mode in an envelope": ({"scheme": SCHEMES["cftsmppc"], "tolerance": None}, 5e-3),
    "sliding mode without an envelope": ({"scheme": SCHEMES["ftsmc"], "tolerance": None}, 2.6e-3),
}
"""By name: changes of the law on a Panda, and an error that some of the motions exceed."""


@pytest.fixture(scope="module")
def two_links(tmp_path_factory):
    scenario = sx.scenarios.load("example-4.1-1khz", NEAR)
    return CompiledAdmission(scenario, tmp_path_factory.mktemp("admission")), certified_law(scenario)


def test_the_tables_in_c_reach_every_growth_rate_that_python_accepts(two_links):
    _, law = two_links
    largest = 0.5 * law.loop.decay
    assert 4.0 * largest % 1.0 > 0.0
    growths, _ = _groups(law.loop, law.uncertainty.region(law.bodies).p)
    # Python rounds a growth rate up to a multiple of 0.25.
    assert growths[-1] == np.ceil(4.0 * largest) / 4.0


def test_admission_in_c_decides_as_python_with_the_same_bounds(two_links):
    assert_same_decisions(*two_links, count=4, allowed=1.6e-4)


@pytest.mark.full
@pytest.mark.parametrize("name", CASES)
def test_admission_in_c_decides_as_python_on_a_panda(name, tmp_path):
    changes, allowed = CASES[name]
    scenario = sx.scenarios.load(PANDA, changes)
    assert_same_decisions(CompiledAdmission(scenario, tmp_path), certified_law(scenario), 20, allowed)


@pytest.mark.full
def test_admission_in_c_gives_the_slowdown_factor_of_python(tmp_path):
    scenario = sx.scenarios.load(PANDA)
    decide, law = CompiledAdmission(scenario, tmp_path), certified_law(scenario)
    slowed = 0
    for motion in random_motions(law, 12, seed=1):
        answer = decide(motion, 1.4e-3, slow_down=True, assume_steps=True)
        expected = admit(law, motion, allowed=1.4e-3, assume_steps=True)
        assert answer.slow_down == pytest.approx(expected.slow_down or 0.0)
        slowed += answer.slow_down > 1.0
    assert slowed


@pytest.mark.full
def test_a_planned_torque_step_beyond_the_limit_is_refused_in_c_as_in_python(tmp_path):
    scenario = sx.scenarios.load("example-4.1-1khz", {**NEAR, "actuator.rate": 150.0})
    decide, law = CompiledAdmission(scenario, tmp_path), certified_law(scenario)
    motions = random_motions(law, 6)
    for motion in motions:
        expected = admit(law, motion, assume_steps=True, slow_down=False)
        answer = decide(motion, assume_steps=True)
        assert (answer.reason == 9) == (expected.limit is not None and expected.limit.what == "planned torque step")
        if answer.reason == 9:
            assert answer.value == pytest.approx(expected.limit.value, rel=1e-6)
            assert law.arm.joint_names[answer.joint] == expected.limit.joint
    assert {decide(motion, assume_steps=True).reason for motion in motions} >= {0, 9}


def test_discontinuous_reversed_and_nan_motions_are_refused(two_links):
    decide, law = two_links
    (motion,) = random_motions(law, 1)
    coefficients, times = np.asarray(motion.coefficients), np.asarray(motion.times)

    class Spoiled:
        def __init__(self, times: Any, coefficients: Any) -> None:
            self.times, self.coefficients = times, coefficients

    jumps = coefficients.copy()
    jumps[-2] += 0.1
    for spoiled in (
        Spoiled(times, coefficients * np.nan),
        Spoiled(times[::-1], coefficients),
        Spoiled(times - 1.0, coefficients),
        Spoiled(times, jumps),
        Spoiled(1e6 * times, coefficients),
    ):
        answer = decide(spoiled, slow_down=True)
        assert answer.reason == 8 and answer.slow_down == 0.0 and not answer.bounded


def test_admission_export_of_an_unsupported_law_is_refused_with_the_reason(tmp_path):
    done = in_process("export", "c", "example-4.1", "--out", str(tmp_path), "--admission", "--quick")
    assert done.exit_code == 2 and "a bound along a motion needs a law in sampled-data form" in done.stderr
    scenario = sx.scenarios.load("example-4.1-1khz")
    with pytest.raises(DefinitionError, match="kind: kalman"):
        export_admission(scenario, project(scenario, with_golden=False), tmp_path)
    with pytest.raises(DefinitionError, match="without --float"):
        export_admission(scenario, project(scenario, single=True, with_golden=False), tmp_path)
