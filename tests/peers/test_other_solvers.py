"""The simulation loop against diffrax and scipy on smooth problems, with its order of convergence."""

from functools import cache

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slidax.core import runge_kutta_4, semi_implicit_euler
from slidax.core.types import State
from slidax.plant import Constant
from slidax.simulation import simulate
from tests.paper_examples import MOTION_4_1, MOTION_4_2, START_4_1, START_4_2, law_4_1, law_4_2, plant_4_1, plant_4_2
from tests.simulation.simple import SMOOTH_PLANT, SPRING

END = 1.2


def closed_loop(plant, controller, trajectory, start):
    """The loop as a plain differential equation, without the stepping of `slidax.simulation`."""
    n = start.q.shape[0]
    memory = controller.init(jnp.zeros(()), start, trajectory.reference(jnp.zeros(())))

    def rate(t, y):
        state = State(q=y[:n], dq=y[n:])
        reference = trajectory.reference(t)
        tau = controller(t, state, reference, reference, memory).tau
        return jnp.concatenate([state.dq, plant.acceleration(t, state, tau)])

    return jax.jit(rate), np.concatenate([start.q, start.dq])


def by_scipy(rate, y0, t0=0.0, t1=END):
    function = lambda t, y: np.asarray(rate(jnp.asarray(t), jnp.asarray(y)))  # noqa: E731
    solution = solve_ivp(function, (t0, t1), y0, method="DOP853", rtol=1e-13, atol=1e-13)
    assert solution.success
    return solution.y[:, -1]


def by_diffrax(rate, y0):
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: rate(t, y)),
        diffrax.Dopri8(),
        t0=0.0,
        t1=END,
        dt0=1e-3,
        y0=jnp.asarray(y0),
        stepsize_controller=diffrax.PIDController(rtol=1e-12, atol=1e-12),
        max_steps=100_000,
    )
    return np.asarray(solution.ys[-1])


@cache
def exact():
    rate, y0 = closed_loop(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1)
    return by_scipy(rate, y0)


def simulated(period, integrator=runge_kutta_4, mode="continuous", substeps=1):
    loop, how = (SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1), {"mode": mode, "integrator": integrator}
    run = simulate(*loop, t1=END, period=period, substeps=substeps, log_every=None, throw=True, **how)
    return np.concatenate([run.state.q, run.state.dq])


def orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.full
def test_diffrax_and_scipy_agree_with_each_other():
    rate, y0 = closed_loop(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1)
    np.testing.assert_allclose(by_diffrax(rate, y0), exact(), atol=1e-9)


@pytest.mark.parametrize(
    ("integrator", "mode", "steps", "order", "room"),
    [
        pytest.param(runge_kutta_4, "continuous", (60, 120, 240, 480), 4.0, 0.25),
        pytest.param(semi_implicit_euler, "continuous", (480, 960, 1920, 3840), 1.0, 0.1, marks=pytest.mark.full),
        pytest.param(runge_kutta_4, "held", (240, 480, 960), 1.0, 0.15),
    ],
)
def test_loop_converges_to_scipy_at_the_order_of_its_step(integrator, mode, steps, order, room):
    errors = [np.abs(simulated(END / n, integrator, mode) - exact()).max() for n in steps]
    assert orders(errors) == pytest.approx([order] * (len(steps) - 1), abs=room)
    assert errors[-1] < 1e-8 or order < 4.0


@cache
def exact_with_a_held_torque(periods):
    """scipy from sample to sample, the torque computed once per sample from the printed formula of the spring."""
    y, h = np.concatenate([START_4_1.q, START_4_1.dq]), END / periods
    reference = jax.jit(lambda t: MOTION_4_1.reference(t))

    @jax.jit
    def rate(t, y, tau):
        state = State(q=y[:2], dq=y[2:])
        return jnp.concatenate([state.dq, SMOOTH_PLANT.acceleration(t, state, tau)])

    for k in range(periods):
        wanted = reference(jnp.asarray(k * h))
        tau = -SPRING.stiffness * (y[:2] - wanted.q) - SPRING.damping * (y[2:] - wanted.dq)
        y = by_scipy(lambda t, y, tau=tau: rate(t, y, tau), y, k * h, (k + 1) * h)
    return y


@pytest.mark.full
@pytest.mark.parametrize(
    ("integrator", "substeps", "order", "room"),
    [(runge_kutta_4, (1, 2, 4, 8), 4.0, 0.3), (semi_implicit_euler, (32, 64, 128), 1.0, 0.1)],
)
def test_the_plant_converges_between_two_samples_at_the_order_of_its_step(integrator, substeps, order, room):
    exact_held = exact_with_a_held_torque(24)
    errors = [np.abs(simulated(END / 24, integrator, "held", substeps=m) - exact_held).max() for m in substeps]
    assert orders(errors) == pytest.approx([order] * (len(substeps) - 1), abs=room)
    assert errors[-1] < 1e-8 or order < 4.0


@pytest.mark.full
@pytest.mark.parametrize(
    ("plant", "law", "trajectory", "start"),
    [
        pytest.param(plant_4_1(), law_4_1(layer=1.0), MOTION_4_1, START_4_1, id="two_link"),
        pytest.param(plant_4_2(Constant(jnp.zeros(3))), law_4_2(layer=1.0), MOTION_4_2, START_4_2, id="scara"),
    ],
)
def test_the_papers_closed_loop_agrees_with_scipy_while_its_error_is_large(plant, law, trajectory, start):
    """Until |ε1| first meets the smooth core the loop is smooth; with a wide layer it is not stiff either."""
    rate, y0 = closed_loop(plant, law, trajectory, start)
    run = simulate(plant, law, trajectory, start, t1=0.3, period=5e-4, mode="continuous", log_every=None, throw=True)
    final = np.concatenate([run.state.q, run.state.dq])
    np.testing.assert_allclose(final, by_scipy(rate, y0, 0.0, 0.3), atol=2e-8)
