"""Adversarial runs of exported laws, from the scenario file to the C code, against every line of the verdict."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import monitor_setting
from slidax.motions.tabulated import Tabulated

from .campaign import KINDS, LIMITED, REJECTED, VOID, Draw, Target, chain_urdf, compiled, scenario_of
from .cases import Members, identified
from .plant import Chain
from .test_tracking_bound import of_the_ellipsoid

MOTIONS, RUNS = 9, 1250
"""Motions of each of the nine cases, and runs along each, in the long test."""

LAW = """
scheme:
  name: computed_torque
  horizon: {horizon}
  sampled_data:
    midpoint: true
    viscous_feedforward: true
    adaptation: null
    estimator: {{kind: kalman, acceleration_density: {density}}}
simulation: {{mode: held, period: {period}, substeps: 4, t1: 1.0}}
"""


def chain_scenario(n: int, folder: Path, **changes: Any) -> Any:
    """A random arm of n joints with a band, friction, encoders and a delay."""
    rng = np.random.default_rng(n)
    (folder / "arm.urdf").write_text(chain_urdf(n, rng, changes.get("sliding", ())))
    values = {"horizon": 0.02, "density": 0.3, "period": 1e-3, "band": 0.03, "delay": 1, "resolution": 1e-5}
    values |= {"start": 0.0, "disturbance": 0.0} | changes
    text = (
        "title: attacked\n"
        "robot: {kind: urdf, file: arm.urdf, nominal: {armature: 0.08, viscous: 0.3}, plant: {coulomb: 0.3}}\n"
        f"trajectory: {{kind: minimum_jerk, times: [0, 0.5], waypoints: [{[0.3] * n}, {[0.6] * n}]}}\n"
        f"start: {{q: {[0.3] * n}}}\n"
        f"sensor: {{resolution: {values['resolution']}, velocity: differenced, delay: {values['delay']}}}\n"
        "actuator: {torque: robot}\n"
        "uncertainty:\n"
        f"  robot.plant.inertial: {{band: {values['band']}}}\n"
        "  robot.plant.coulomb: {between: [0.0, 0.3]}\n"
        "  robot.plant.viscous: {between: [0.25, 0.35]}\n"
        f"  start.q: {{between: [{[0.3 - values['start']] * n}, {[0.3 + values['start']] * n}], each: joint}}\n"
        "disturbance:\n"
        f"  terms: [{{kind: harmonic, amplitude: {[values['disturbance']] * n}, frequency: 9.0}}]\n"
        + LAW.format(**values)
    )
    return scenario_of(text, folder)


def arm_scenario(name: str, folder: Path, p: float, **changes: Any) -> Any:
    """A built-in arm with a payload and an identified ellipsoid of parameters."""
    arm, band = identified(name, p)
    n = arm.joints
    load = {"panda": 2.0, "ur5e": 3.0}[name]
    start = np.round(np.clip(0.5 * (np.asarray(arm.limits.lower) + np.asarray(arm.limits.upper)), -1.5, 1.5), 3)
    values = {"horizon": 0.02, "density": 0.3, "period": 1e-3, "resolution": 1e-6, "delay": 1, **changes}
    text = (
        "title: attacked\n"
        f"robot: {{kind: {name}, nominal: {{armature: 0.1, viscous: 0.2, load: {{mass: {load}, center: [0, 0, 0.1], "
        f"inertia: {0.0025 * load}}}}}, plant: {{coulomb: 0.3}}}}\n"
        "trajectory: {kind: minimum_jerk, times: [0, 0.5], "
        f"waypoints: [{start.tolist()}, {(start + 0.1).tolist()}]}}\n"
        f"start: {{q: {start.tolist()}}}\n"
        f"sensor: {{resolution: {values['resolution']}, velocity: differenced, delay: {values['delay']}}}\n"
        "actuator: {torque: robot}\n"
        "uncertainty:\n"
        f"  robot.plant.inertial: {{band: {p}, confidence: 0.95, deviations: {band.deviations.tolist()}}}\n"
        "  robot.plant.coulomb: {between: [0.0, 0.3]}\n" + LAW.format(**values)
    )
    assert n == len(start)
    return scenario_of(text, folder)


def motion_of(scenario: Any, rng: np.random.Generator, share: float) -> Any:
    """A motion of 0.3 to 0.6 s through two or three points, from the start of the scenario."""
    arm = scenario.controller.nominal
    start = np.asarray(scenario.state0.q, float)
    n, count = arm.joints, int(rng.integers(2, 4))
    steps = rng.uniform(-1.0, 1.0, size=(count - 1, n)) * share * 0.35
    points = np.concatenate([start[None], start + np.cumsum(steps, axis=0)])
    points = np.clip(points, np.asarray(arm.limits.lower) + 0.05, np.asarray(arm.limits.upper) - 0.05)
    points[0] = start
    times = np.linspace(0.0, rng.uniform(0.3, 0.6), count)
    return Tabulated.through(times, points, np.zeros_like(points), np.zeros_like(points))


def of_the_band(p: float) -> Draw:
    """Draw arms at the edge of the band, with viscous friction at both ends."""

    def draw(nominal: Chain, rng: np.random.Generator) -> Chain:
        member = nominal.member(rng, p)
        return Chain(
            **{**vars(member), "viscous": nominal.viscous + 0.05 * rng.choice([-1.0, 1.0], nominal.viscous.shape)}
        )

    return draw


CASES: dict[str, dict[str, Any]] = {
    "1": {"n": 1, "start": 1e-3},
    "2": {"n": 2, "period": 2e-3, "delay": 2, "disturbance": 0.4},
    "3": {"n": 3, "sliding": (2,), "delay": 0},
    "4": {"n": 4, "start": 5e-4},
    "5": {"n": 5, "band": 0.015, "delay": 0},
    "6": {"n": 6, "band": 0.01, "disturbance": 0.2},
    "7": {"n": 7, "band": 0.015},
    "panda": {"p": 0.02},
    "ur5e": {"p": 0.02, "period": 2e-3, "delay": 0},
}
"""Arms of 1 to 7 joints with a band per body, and two arms with an identified ellipsoid."""


class Case:
    """The exported law of a case and its admitted motions."""

    def __init__(self, name: str, folder: Path) -> None:
        self.options = dict(CASES[name])
        n = self.options.pop("n", None)
        self.name = name
        self.scenario = (
            arm_scenario(name, folder, **self.options) if n is None else chain_scenario(n, folder, **self.options)
        )
        self.library = compiled(self.scenario, folder)

    def target(self, rng: np.random.Generator, allowed: Any = None) -> Target:
        """Return a random motion, slowed down until it is admitted."""
        for share in 0.7 ** np.arange(3 if self.scenario.controller.joints > 3 else 0, 16):
            target = Target.of(self.scenario, motion_of(self.scenario, rng, share), self.library, allowed)
            if target is not None:
                return target
        raise AssertionError(f"no motion of case {self.name} is admitted")

    def draw(self, target: Target) -> Draw:
        if "n" in CASES[self.name]:
            return of_the_band(self.options.get("band", 0.03))
        return of_the_ellipsoid(Members(self.name), target.certified)


def assert_every_line_holds(target: Target, outcomes: np.ndarray) -> None:
    """Assert that no bound is exceeded and that the gate and the torque limits stay inactive, as `proved`."""
    worst = dict(zip(KINDS, outcomes["worst"].max(axis=0), strict=True))
    assert all(share <= 1.0 for share in worst.values()), worst
    lines = {line.text.split(":")[0]: line.status for line in target.answer.verdict.assumptions}
    assert lines["the measurement gate rejects no sample of the arm itself"] == "proved"
    assert not outcomes["rejected"].any()
    assert not np.any(outcomes["status"] & (REJECTED | LIMITED))


@pytest.fixture(scope="module")
def scara(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return Case("3", tmp_path_factory.mktemp("scara"))


def test_adversarial_runs_of_an_exported_law_stay_within_its_certified_bounds(scara: Case) -> None:
    rng = np.random.default_rng(2)
    target = scara.target(rng)
    outcomes = target.attack(rng, scara.draw(target), 200, 24)
    assert_every_line_holds(target, outcomes)
    # The runs reach a quarter of the bound.
    assert outcomes["worst"][:, 0].max() > 0.25


def test_adversarial_runs_of_arms_outside_the_set_exceed_the_bounds(scara: Case) -> None:
    rng = np.random.default_rng(4)
    assert scara.target(rng).attack(rng, of_the_band(0.5), 100)["worst"][:, 0].max() > 1.0


@pytest.mark.full
@pytest.mark.parametrize("name", CASES)
def test_many_adversarial_runs_of_an_exported_law_stay_within_its_certified_bounds(name: str, tmp_path: Path) -> None:
    case, rng = Case(name, tmp_path), np.random.default_rng(3)
    worst = np.zeros(len(KINDS))
    for _ in range(MOTIONS):
        target = case.target(rng)
        outcomes = target.attack(rng, case.draw(target), RUNS)
        assert_every_line_holds(target, outcomes)
        worst = np.maximum(worst, outcomes["worst"].max(axis=0))
    print(f"{name}: {MOTIONS * RUNS} runs, largest share of", dict(zip(KINDS, worst.round(3).tolist(), strict=True)))


MONITORED = "scheme.sampled_data.monitor"

WITHIN = 0.003
"""Largest allowed error along the motions of the monitored law, rad or m."""


def monitored(name: str, folder: Path, motions: int, rng: np.random.Generator) -> tuple[Case, list[Target]]:
    """Return a case whose law monitors some admitted motions, and these motions."""
    case = Case(name, folder)
    targets = [case.target(rng, WITHIN) for _ in range(motions)]
    setting = monitor_setting([target.answer for target in targets])
    library = compiled(sx.scenarios.load(str(folder / "scenario.yaml"), {MONITORED: setting}), folder / "monitored")
    return case, [replace(target, library=library) for target in targets]


def outside(case: Case, target: Target, rng: np.random.Generator, runs: int) -> np.ndarray:
    """Run arms outside the set: with an unknown payload, more friction and more disturbance."""

    def draw(nominal: Chain, rng: np.random.Generator) -> Chain:
        bodies = nominal.bodies.copy()
        last = bodies[nominal.carrier == nominal.carrier.max()].sum(axis=0)
        bodies[-1] += rng.uniform(0.0, 2.0) * last
        return Chain(**{**vars(nominal.member(rng, 0.1)), "bodies": bodies})

    return target.attack(rng, draw, runs, allowed=WITHIN, larger=(1.0, 30.0))


def assert_monitor_follows_the_theorem(case: Case, targets: list[Target], inside: int, without: int) -> None:
    rng = np.random.default_rng(6)
    alarms = [target.attack(rng, case.draw(target), inside // len(targets))["status"] & VOID for target in targets]
    assert not np.concatenate(alarms).any()
    outcomes = np.concatenate([outside(case, target, rng, without // len(targets)) for target in targets])
    left = outcomes[outcomes["left"] >= 0.0]
    warned = (left["alarm"] >= 0.0) & (left["alarm"] <= left["left"])
    early = 1e3 * np.median((left["left"] - left["alarm"])[warned])
    print(
        f"{case.name}: {inside} runs inside, no alarm; {len(outcomes)} outside, {len(left)} left, "
        f"{int(warned.sum())} warned before, by {early:.0f} ms in the median"
    )
    assert len(left) > 0.1 * len(outcomes)
    assert warned.mean() >= 0.95


def test_monitor_of_admitted_motions_alarms_only_for_arms_outside_the_set(tmp_path: Path) -> None:
    case, targets = monitored("3", tmp_path, 2, np.random.default_rng(5))
    assert_monitor_follows_the_theorem(case, targets, 200, 200)


@pytest.mark.full
@pytest.mark.parametrize("name", ["3", "panda"])
def test_monitor_of_admitted_motions_never_alarms_in_many_runs_of_the_set(name: str, tmp_path: Path) -> None:
    case, targets = monitored(name, tmp_path, 5, np.random.default_rng(5))
    assert_monitor_follows_the_theorem(case, targets, 10_000, 1000)
