"""A Panda under the sampled-data law that touches a table or drops its payload."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms import Joint, Mismatch, Payload, TimedPayload, assemble
from slidax.core.types import State
from slidax.law import FixedTime, Recovery, UncertaintyBound, cftsmppc, sampled_data
from slidax.motions import MinimumJerk
from slidax.plant import Actuator, Constant, TorqueLimits
from slidax.simulation import MujocoPlant, Plant, Table, simulate
from slidax.simulation.mujoco_model import World

pytest.importorskip("mujoco")

PERIOD = 1e-3
NOMINAL = eqx.tree_at(lambda arm: arm.armature, arms.panda(), jnp.full(7, 0.1))
LIMITS = TorqueLimits(NOMINAL.limits.torque, NOMINAL.limits.torque_rate)
RADIUS, OVERSHOOT = 0.005, 0.3
LAW = sampled_data(
    cftsmppc(
        NOMINAL,
        performance=FixedTime(0.1, RADIUS, 0.4, 2.01),
        overshoot=OVERSHOOT,
        bound=UncertaintyBound(1.0, 1.0, 0.0, 0.0, 0.0, 20.0),
        k1=0.5,
        k2=1.0,
        layer=0.0,
    ),
    period=PERIOD,
    horizon=7e-3,
    limits=LIMITS,
    recovery=Recovery(),
)
# The home posture of the manufacturer's examples, and a posture with the tip 50 mm lower.
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
LOW = np.array([0.0, -0.810134, 0.0, -2.499089, 0.0, 1.688955, 0.785])
DOWN_AND_UP = MinimumJerk.through([0.0, 0.5, 1.0], np.stack([HOME, LOW, HOME]))
RADIUS_OF_TIP = 0.01


def run(load=None, surroundings=None, t1=1.0):
    """The arm is 15 % lighter than its law believes, and its joints have friction."""
    load = TimedPayload(Payload()) if load is None else load
    mismatch = Mismatch(mass_factor=0.85, coulomb=0.3, viscous=0.2, load=load)
    plant = Plant.of_nominal(NOMINAL, mismatch, Constant(jnp.zeros(7)), actuator=Actuator(LIMITS))
    stand_in = MujocoPlant.of(plant, surroundings=surroundings)
    start = State(q=jnp.asarray(HOME), dq=jnp.zeros(7))
    how = {"t1": t1, "period": PERIOD, "substeps": 10, "outside": "recover"}
    return simulate(stand_in, LAW, DOWN_AND_UP, start, **how)


def tips(q):
    return np.asarray(jax.jit(jax.vmap(lambda q: NOMINAL.tip(q)))(jnp.asarray(q)))


def pressing(depth):
    """Return a run whose reference presses the tip's ball `depth` into the table, and its least height above it."""
    height = tips(LOW[None])[0, 2] - RADIUS_OF_TIP + depth
    done = run(surroundings=Table(height, 0.3))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((done.log, done.tally.late_error)))
    assert (np.abs(done.log.tau) <= np.asarray(LIMITS.torque) + 1e-9).all()
    return done, tips(done.log.state.q)[:, 2].min() - RADIUS_OF_TIP - height


def test_table_contact_half_a_millimetre_deep_stays_within_the_envelope():
    free, above = pressing(-0.005)
    assert free.outcome.ok and 0.0045 < above < 0.0055
    touching, above = pressing(0.0005)
    assert touching.outcome.ok and touching.tally.violations == 0
    # The table holds the tip up, which takes torque.
    assert -1e-4 < above < 0
    assert touching.tally.peak_torque[3] > free.tally.peak_torque[3] + 1.0


def test_pressing_five_millimetres_into_the_table_leaves_the_envelope_and_recovers():
    """The arm cannot follow its reference into the rigid table, so that the error stays until the reference rises."""
    pressed, above = pressing(0.005)
    assert -2e-4 < above < 0
    outcome = pressed.outcome
    assert outcome.kind == "recovered"
    assert 0.3 < outcome.t < 0.5 < outcome.back < 0.8
    assert 0.002 < outcome.beyond < 0.02
    assert np.abs(pressed.log.e[-50:]).max() < OVERSHOOT * RADIUS / 10


def test_a_released_payload_falls_onto_the_table_and_comes_to_rest():
    center, half = np.array([0.0, 0.0, 0.1]), 0.5 * np.sqrt(6.0 * 0.004 / 2.0)
    load = TimedPayload(Payload(2.0, center, 0.004), released=0.4)
    dropped = run(load, Table(0.25), t1=1.5)
    assert dropped.outcome.ok
    way = dropped.load
    assert way.t[0] == pytest.approx(0.4) and way.t[-1] == 1.5
    centers = way.position + way.rotation @ center
    # The released body starts with the tip's velocity and falls under gravity alone.
    k = 400
    at_tip = tips(dropped.log.state.q[k - 1 : k + 2])
    np.testing.assert_allclose(way.position[0], at_tip[1], atol=1e-12)
    spin = way.rotation[1] @ way.rotation[0].T
    velocity = (at_tip[2] - at_tip[0]) / (2 * PERIOD) + np.cross(
        np.array([spin[2, 1], spin[0, 2], spin[1, 0]]) / PERIOD, way.rotation[0] @ center
    )
    fall = way.t[:100, None] - way.t[0]
    flight = centers[0] + fall * velocity - 0.5 * 9.81 * fall**2 * np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(centers[:100], flight, atol=1e-3)
    # Its inertia is that of a cube, which comes to rest on a face.
    np.testing.assert_allclose(centers[-1, 2], 0.25 + half, atol=1e-4)
    assert np.abs(way.position[-1] - way.position[-50]).max() < 1e-6
    # The law knows neither the payload nor its release time.
    jump = np.abs(dropped.log.e[k : k + 50]).max()
    before = np.abs(dropped.log.e[k - 50 : k]).max()
    assert 3.0 * before < jump < RADIUS


@pytest.mark.parametrize("inertia", [0.0, [0.0, 0.006, 0.006], [0.004, 0.009, 0.006]])
def test_released_point_rod_and_brick_payloads_fall_onto_the_table_and_rest(inertia):
    load = TimedPayload(Payload(0.5, (0.0, 0.02, 0.1), np.diag(np.broadcast_to(inertia, 3))), released=0.3)
    plant = MujocoPlant(NOMINAL, Constant(jnp.zeros(7)), load=load, surroundings=Table(0.2))
    state = State(q=jnp.asarray(HOME), dq=jnp.linspace(-0.5, 0.5, 7))
    world = World(plant, 1e-3, state)
    for step in range(2000):
        world.step(step * 1e-3)
    before, at = world.body, world.data.body("released load")
    assert 0.2 < at.xipos[2] < 0.4
    world.step(2.0)
    np.testing.assert_allclose(world.body, before, atol=1e-5)


@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_friction_brakes_a_payload_that_slides_on_the_table(friction):
    """A box released on the table at 1 m/s slides by v²/(2 μ g)."""
    body = {"mass": 1.0, "inertia": 0.01 * np.eye(3)}
    rail = Joint("rail", "prismatic", None, "cart", axis=np.array([1.0, 0.0, 0.0]), **body)
    arm = assemble([rail], tip="cart")
    load = TimedPayload(Payload(2.0, inertia=0.002), released=1e-9)
    half = 0.5 * np.sqrt(6.0 * 0.002 / 2.0)
    plant = MujocoPlant(arm, Constant(jnp.zeros(1)), load=load, surroundings=Table(-half, friction), tip_radius=0.001)
    world = World(plant, 1e-4, State(q=jnp.zeros(1), dq=jnp.ones(1)))
    for step in range(12_000):
        world.step(step * 1e-4)
    np.testing.assert_allclose(world.body[0], 1.0 / (2.0 * friction * 9.81), rtol=0.02)
    np.testing.assert_allclose([world.q[0], world.body[2]], [1.2, 0.0], atol=1e-4)


def test_a_carried_payload_collides_with_the_table():
    center, half = np.array([0.0, 0.0, 0.05]), 0.5 * np.sqrt(6.0 * 0.0002 / 0.5)
    load = TimedPayload(Payload(0.5, center, 0.0002))
    corners = center + half * np.array(list(itertools.product((-1, 1), repeat=3)))

    def lowest(q):
        rotation, place = (np.asarray(x) for x in NOMINAL.tip_frame(jnp.asarray(q)))
        return (place + corners @ rotation.T)[:, 2].min()

    height = lowest(HOME) - 0.03
    stopped, free = run(load, Table(height), t1=0.5), run(load, t1=0.5)
    assert lowest(free.log.state.q[-1]) < height - 0.015
    assert -2e-4 < lowest(stopped.log.state.q[-1]) - height < 1e-5
