"""MuJoCo as the plant: the same mechanics from an independent code, in the same loop."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms import Joint, Payload, TimedPayload, assemble
from slidax.core import runge_kutta_4, semi_implicit_euler
from slidax.core.errors import DefinitionError, OutcomeError
from slidax.core.types import State
from slidax.motions import ConstantPosture as Still
from slidax.motions import Sinusoid
from slidax.plant import Actuator, Constant, Delayed, Encoders, Harmonic, Lossy, TorqueLimits
from slidax.simulation import MujocoPlant, Plant, Table, simulate, simulate_batch
from slidax.simulation.mujoco_model import World
from tests.paper_examples import MOTION_4_1, START_4_1, TWO_LINK
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Breaks, Spring, Witness

mujoco = pytest.importorskip("mujoco")


def turned(angle, axis):
    """Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def link(name, kind, parent, **more):
    body = {"mass": 2.0, "center": np.array([0.05, -0.02, 0.1]), "inertia": np.diag([0.03, 0.04, 0.02])}
    return Joint(name, kind, parent, f"{name} link", **(body | more))


# Two arms on a cart; MuJoCo orders the joints differently, one arm after the other.
TREE = assemble(
    [
        link("cart", "prismatic", None, axis=np.array([1.0, 0.0, 0.0]), mass=5.0),
        # Its link has no mass, which MuJoCo does not accept as it is.
        Joint("left", "revolute", "cart", "left link", turned(0.7, [1, 2, 3]), np.array([0.1, 0.2, 0.3])),
        link("right", "revolute", "cart", axis=np.array([1.0, 1.0, 0.2]), translation=np.array([0.0, -0.3, 0.1])),
        link("reach", "prismatic", "left", axis=np.array([0.0, 1.0, 1.0]), armature=0.3),
        link("wrist", "revolute", "right", rotation=turned(-1.2, [0, 1, 1]), translation=np.array([0.0, 0.1, 0.4])),
        link("last", "revolute", "reach", axis=np.array([0.0, 1.0, 0.0]), armature=0.1),
    ],
    tip="last link",
    gravity=(0.5, -1.0, -9.0),
    name="tree",
)
PANDA = eqx.tree_at(lambda arm: arm.armature, arms.panda(), jnp.full(7, 0.1))
ARMS = {"panda": PANDA, "tree": TREE}
EACH_ARM = pytest.mark.parametrize("name", [pytest.param("panda", marks=pytest.mark.full), "tree"])
"""Daily tests use the tree, whose joint order differs from MuJoCo's; the Panda is simpler."""
LOAD = TimedPayload(Payload(2.0, (0.01, -0.02, 0.1), np.diag([0.004, 0.005, 0.006])), attached=0.02, released=0.08)


def plant_of(robot, **more):
    return Plant(robot, **({"disturbance": Constant(jnp.zeros(robot.joints))} | more))


def smooth_loop(robot, **more):
    """A spring that pulls all joints, with a motion to follow."""
    n = robot.joints
    motion = Sinusoid(np.linspace(-0.5, 0.8, n), np.linspace(0.3, 0.2, n), np.linspace(2.0, 6.0, n), np.arange(n))
    start = State(q=motion.position(jnp.zeros(())) + 0.1, dq=jnp.linspace(0.5, -0.5, n))
    law = Spring(jnp.linspace(200.0, 60.0, n), jnp.linspace(20.0, 6.0, n), n)
    return plant_of(robot, **more), law, motion, start


def both(plant, *rest, integrator, t1=0.1, **how):
    """Return the run by MuJoCo and the run by slidax."""
    how = {"t1": t1, "period": 1e-3, "substeps": 5, **how}
    name = {semi_implicit_euler: "euler", runge_kutta_4: "rk4"}[integrator]
    theirs = simulate(MujocoPlant.of(plant, integrator=name), *rest, **how)
    return theirs, simulate(plant, *rest, integrator=integrator, **how)


@eqx.filter_jit
def mechanics(arm, q, dq, tau):
    return arm.mass(q), arm.bias(q, dq), arm.acceleration(State(q, dq), tau), arm.tip(q)


@EACH_ARM
def test_mujocos_inertia_bias_acceleration_and_tip_match_slidax_with_and_without_payload(name):
    robot = ARMS[name]
    n = robot.joints
    world = World(MujocoPlant.of(plant_of(robot, load=LOAD)), 1e-4, State(q=jnp.zeros(n), dq=jnp.zeros(n)))
    random = np.random.default_rng(1)
    for time in (0.0, 0.05, 0.1):
        world.advance_to(time)
        arm = LOAD.on(robot, jnp.asarray(time))
        model, data, at = world.model, world.data, world.dofs
        for _ in range(20):
            q, dq, tau = random.uniform(-3, 3, n), random.normal(0, 2, n), random.normal(0, 20, n)
            data.qpos[at], data.qvel[at], data.qfrc_applied[at] = q, dq, tau
            mujoco.mj_forward(model, data)
            inertia = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, inertia)
            theirs = inertia[np.ix_(at, at)], data.qfrc_bias[at], data.qacc[at], data.site("tip").xpos
            for mine, other in zip(mechanics(arm, q, dq, tau), theirs, strict=True):
                np.testing.assert_allclose(mine, other, rtol=0, atol=1e-10 * max(1.0, np.abs(other).max()))


def test_a_released_payload_starts_with_the_velocity_of_the_tip():
    h, state = 1e-5, State(q=jnp.linspace(-1.0, 1.0, 6), dq=jnp.linspace(3.0, -4.0, 6))
    load = TimedPayload(Payload(2.0, (0.01, -0.02, 0.1), 0.004), released=h / 2)
    world = World(MujocoPlant.of(plant_of(TREE, load=load)), h, state)
    world.advance_to(h)
    world.step(h)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, world.body[3:])
    turned, place = TREE.tip_frame(state.q + h * state.dq)
    assert np.abs(turned - TREE.tip_frame(state.q)[0]).max() > 1e-5
    np.testing.assert_allclose(rotation.reshape(3, 3), turned, rtol=0, atol=1e-7)
    np.testing.assert_allclose(world.body[:3], place, rtol=0, atol=1e-7)


@EACH_ARM
def test_mujoco_with_semi_implicit_euler_gives_the_run_of_slidax(name):
    """The payload is attached and released, and the disturbance changes within the periods."""
    n = ARMS[name].joints
    loop = smooth_loop(ARMS[name], load=LOAD, disturbance=Harmonic(jnp.full(n, 3.0), 900.0, 0.3))
    theirs, ours = both(*loop, integrator=semi_implicit_euler, t1=0.2, limits="ignore")
    np.testing.assert_allclose(theirs.log.state.q, ours.log.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(theirs.log.state.dq, ours.log.state.dq, rtol=0, atol=1e-8)
    np.testing.assert_allclose(theirs.tally.late_error, ours.tally.late_error, rtol=1e-7, atol=1e-12)
    assert np.abs(np.diff(ours.log.state.q, axis=0)).max() > 1e-3


def test_mujoco_with_sensors_and_drives_gives_the_run_of_slidax():
    """Torques with limits, rate, lag and dead time; measurements with delay, noise and lost samples."""
    drive = Actuator(TorqueLimits(40.0, 4000.0), time_constant=2e-3, dead_time=1.4)
    sensor = Lossy(Delayed(Encoders(0.0, position_noise=1e-5, seed=2), 1.0), 0.2)
    loop = smooth_loop(TREE, sensor=sensor, actuator=drive)
    theirs, ours = both(*loop, integrator=semi_implicit_euler)
    np.testing.assert_allclose(np.abs(np.diff(ours.log.tau, axis=0)).max(), 4.0)
    np.testing.assert_allclose(theirs.log.state.q, ours.log.state.q, rtol=0, atol=1e-9)
    assert theirs.outcome == ours.outcome


@pytest.fixture
def damped():
    joints = [link("slide", "prismatic", None, viscous=8.0), link("hinge", "revolute", "slide", viscous=3.0)]
    turned_hinge = dataclasses.replace(joints[1], axis=np.array([1.0, 0.0, 0.3]))
    return smooth_loop(assemble([joints[0], turned_hinge], tip="hinge link"))


def test_mujoco_with_runge_kutta_and_viscous_friction_gives_the_run_of_slidax(damped):
    theirs, ours = both(*damped, integrator=runge_kutta_4)
    np.testing.assert_allclose(theirs.log.state.q, ours.log.state.q, rtol=0, atol=1e-11)


def test_implicitfast_converges_with_shorter_steps(damped):
    plant, *rest = damped
    how = {"t1": 0.1, "period": 1e-3}
    exact = simulate(plant, *rest, integrator=runge_kutta_4, substeps=5, **how).state.q
    runs = [simulate(MujocoPlant.of(plant), *rest, substeps=m, **how) for m in (5, 10)]
    errors = [np.abs(run.state.q - exact).max() for run in runs]
    assert errors[1] < 0.6 * errors[0] < 1e-3


def test_a_joint_with_coulomb_friction_sticks_and_then_slides():
    slide = link("slide", "prismatic", None, axis=np.array([1.0, 0.0, 0.0]), mass=2.0, coulomb=4.0)
    arm = assemble([slide], tip="slide link", name="slide")
    rest = Spring(jnp.zeros(1), jnp.zeros(1), 1), Still([0.0]), State(q=jnp.zeros(1), dq=jnp.zeros(1))

    def end(push):
        plant = MujocoPlant(arm, Constant(jnp.array([push])), dry=True)
        return float(simulate(plant, *rest, t1=1.0, period=1e-3, substeps=10, log_every=None).state.q[0])

    assert abs(end(3.9)) < 1e-5
    np.testing.assert_allclose(end(6.0), 0.5 * (6.0 - 4.0) / 2.0, rtol=2e-3)


def test_a_joint_stops_at_its_limit_if_limits_are_simulated():
    slide = link("slide", "prismatic", None, axis=np.array([1.0, 0.0, 0.0]), lower=-0.1, upper=0.2)
    arm = assemble([slide], tip="slide link", name="slide")
    rest = Spring(jnp.zeros(1), jnp.zeros(1), 1), Still([0.0]), State(q=jnp.zeros(1), dq=jnp.ones(1))

    def end(stops):
        plant = MujocoPlant.of(plant_of(arm, disturbance=Constant(jnp.ones(1))), stops=stops)
        return float(simulate(plant, *rest, t1=1.0, period=1e-3, log_every=None).state.q[0])

    assert end(False) > 1.0
    assert abs(end(True) - 0.2) < 1e-4


@pytest.mark.full
def test_both_engines_give_the_same_mujoco_run_whatever_is_logged():
    loop = smooth_loop(TREE, load=LOAD, sensor=Encoders(resolution=1e-6), actuator=Actuator(time_constant=1e-3))
    plant = MujocoPlant.of(loop[0])
    how = {"t1": 0.1, "period": 1e-3, "substeps": 2}
    native = simulate(plant, *loop[1:], engine="native", log_every=1, **how)
    xla = simulate(plant, *loop[1:], engine="xla", log_every=7, **how)
    assert xla.log.k.tolist() == list(range(0, 101, 7))
    assert jax.tree.structure(native.tally) == jax.tree.structure(xla.tally)
    np.testing.assert_allclose(native.log.state.q[::7], xla.log.state.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose(native.tally.torque_square, xla.tally.torque_square, rtol=1e-6)
    assert xla.load.t.tolist() == pytest.approx([0.084, 0.091, 0.098])
    np.testing.assert_allclose(native.load.position[4::7], xla.load.position, rtol=0, atol=1e-8)
    unlogged = simulate(plant, *loop[1:], engine="native", log_every=None, **how)
    assert unlogged.log is None and unlogged.load is None
    for ours, theirs in zip(jax.tree.leaves(native.tally), jax.tree.leaves(unlogged.tally), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_law_is_called_once_a_period_with_the_state_at_the_sample():
    plant, law, motion, start = smooth_loop(TREE)
    log = simulate(MujocoPlant.of(plant), Witness(law), motion, start, t1=0.05, period=1e-2, substeps=3).log
    assert log.signals["count"].tolist() == list(range(6))
    np.testing.assert_array_equal(log.signals["q"], log.state.q)


def test_a_mujoco_run_that_leaves_its_envelope_or_diverges_ends_as_in_slidax(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant, law, motion, start = smooth_loop(TREE)
    still = State(q=motion.position(jnp.zeros(())), dq=motion.reference(jnp.zeros(())).dq)
    theirs, ours = both(plant, BoundedLaw(law, jnp.asarray(0.02)), motion, still, integrator=semi_implicit_euler)
    assert theirs.outcome.kind == "left_envelope"
    assert (theirs.outcome.t, theirs.outcome.joint) == (ours.outcome.t, ours.outcome.joint)
    assert len(theirs.log.t) == len(ours.log.t) == int(theirs.tally.samples)
    breaks = Breaks(law, jnp.asarray(0.03), 4)
    theirs, ours = both(plant, breaks, motion, start, integrator=semi_implicit_euler)
    assert theirs.outcome == ours.outcome
    assert theirs.outcome.kind == "not_finite"
    torn = plant_of(TREE, disturbance=Constant(jnp.full(6, 1e25)))
    with pytest.raises(OutcomeError, match="became infinite or undefined"):
        simulate(MujocoPlant.of(torn, surroundings=Table(0.0)), law, motion, start, t1=0.1, period=1e-3, throw=True)
    assert list(tmp_path.iterdir()) == []


def test_options_that_mujoco_lacks_are_refused():
    plant, *rest = smooth_loop(TREE)
    stand_in = MujocoPlant.of(plant)
    how = {"t1": 0.01, "period": 1e-3}
    with pytest.raises(DefinitionError, match="MujocoPlant needs samples: simulate in held mode"):
        simulate(stand_in, *rest, mode="continuous", **how)
    law, motion, start = rest
    with pytest.raises(DefinitionError, match="MuJoCo cannot be traced"):
        jax.jit(lambda q: simulate(stand_in, law, motion, State(q, start.dq), **how).state.q)(start.q)
    with pytest.raises(DefinitionError, match="MuJoCo moves one arm at a time"):
        simulate_batch(lambda q: (stand_in, law, motion, State(q, start.dq)), start.q[None], **how)
    with pytest.raises(DefinitionError, match=r"a MujocoPlant needs an `Articulated` arm.*got a TwoLink"):
        MujocoPlant(TWO_LINK, Constant(jnp.zeros(2)))
    with pytest.raises(DefinitionError, match="`implicitfast`, `implicit`, `euler`, `rk4`; got 'rk45'"):
        MujocoPlant.of(plant, integrator="rk45")
    flat = Payload(1.0, inertia=np.diag([0.01, 0.01, 0.03]))
    with pytest.raises(DefinitionError, match="no rigid body has this `Payload"):
        MujocoPlant.of(plant_of(TREE, load=TimedPayload(flat)))
    with pytest.raises(DefinitionError, match=r"`Table.friction` must be > 0; got 0"):
        Table(0.0, 0.0)


def test_a_missing_mujoco_is_reported_with_the_install_command(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    plant, *rest = smooth_loop(TREE)
    with pytest.raises(DefinitionError, match=r"which is not installed: pip install 'slidax\[robots\]'"):
        simulate(MujocoPlant.of(plant), *rest, t1=0.01, period=1e-3)


def test_the_plant_of_slidax_runs_without_mujoco(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    assert simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.1, period=0.01).outcome.ok


def test_a_mujoco_run_shows_its_progress_bar_on_request(capfd):
    plant, *rest = smooth_loop(TREE)
    simulate(MujocoPlant.of(plant), *rest, t1=0.01, period=1e-3, progress=True)
    assert "simulating" in capfd.readouterr().err
