"""The laws and loops that slidax shares with OpenSMC, a NumPy toolbox for sliding mode control."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from opensmc import reaching as peer_reaching
from opensmc import surfaces as peer_surfaces
from opensmc.controllers import NFTSMC, ClassicalSMC, FixedTimeSMC
from opensmc.plants import DoubleIntegrator
from opensmc.reaching import Saturation
from opensmc.reaching import SuperTwisting as SuperTwistingReaching
from opensmc.simulator import Simulator

from slidax import simulate
from slidax.arms import AbstractRobot
from slidax.core import saturation, semi_implicit_euler, sig
from slidax.core.errors import as_array
from slidax.core.types import Reference, Scalar, State
from slidax.law import (
    AbstractController,
    FixedTimeReaching,
    Linear,
    LinearCoreFixedTime,
    SingularityFree,
    SlidingMode,
    SlotineLi,
    SmoothFixedTime,
    SuperTwisting,
    TwoPowerReaching,
    UncertaintyBound,
    Unconstrained,
)
from slidax.motions import ConstantPosture
from slidax.plant import Constant as ConstantForce
from slidax.plant import Harmonic
from slidax.simulation import Plant

NEXT_TO_ONE = float(np.nextafter(1.0, 2.0))
NONE = 1e-300
"""A negligible value for a positive parameter whose term OpenSMC does not have."""


class OneJoint(AbstractRobot):
    """`J q̈ = τ + τ_d`: a prismatic joint on a level rail."""

    joint_units: ClassVar[tuple[str, ...]] = ("m",)
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1",)
    inertia: Scalar = eqx.field(converter=as_array, default=1.0)

    def mass(self, q):
        return self.inertia * jnp.eye(1)

    def bias(self, q, dq):
        return jnp.zeros_like(q)

    def friction(self, dq):
        return jnp.zeros_like(dq)

    def potential(self, q):
        return jnp.zeros(())

    def tip(self, q):
        return jnp.concatenate([q, jnp.zeros(2)])


class Pair(NamedTuple):
    """The same law in OpenSMC and in slidax.

    - `peer`: creates OpenSMC's law, whose memory is in the object.
    - `ours`: slidax's law.
    - `sign`: sign of OpenSMC's sliding variable relative to slidax's.
    - `inertia`: inertia of the joint.
    - `accelerates`: True if OpenSMC's law uses the reference acceleration; if not, it must be zero to agree.
    - `reach`: both formulas agree for errors below this.
    """

    peer: Callable[[], Any]
    ours: AbstractController
    sign: float = -1.0
    inertia: float = 1.0
    accelerates: bool = False
    reach: float = 3.0


def robust(size: float) -> UncertaintyBound:
    """A robust torque of constant size."""
    return UncertaintyBound(1.0, 1.0, 0.0, 0.0, 0.0, size)


J = 1.7
CLASSICAL = Pair(
    lambda: ClassicalSMC(c=4.0, k=3.0, eta=2.0, J=J),
    SlotineLi(OneJoint(J), Unconstrained(), Linear(4.0), damping=3.0 * J, gain=2.0 * J, layer=0.0),
    inertia=J,
    accelerates=True,
)
BOUNDARY_LAYER = Pair(
    lambda: ClassicalSMC(reaching=Saturation(k=6.0, phi=0.5), c=4.0, J=J),
    SlotineLi(OneJoint(J), Unconstrained(), Linear(4.0), damping=0.0, gain=6.0 * J, layer=0.5),
    inertia=J,
    accelerates=True,
)
FIXED_TIME = Pair(
    lambda: FixedTimeSMC(c=4.0, alpha=3.0, beta=2.0, p=0.6, q=1.4),
    SlidingMode(
        OneJoint(), Unconstrained(), Linear(4.0), TwoPowerReaching(k1=2.0, k2=3.0, v1=1.4, v2=0.6), robust(NONE)
    ),
)
NONSINGULAR_FAST_TERMINAL = Pair(
    lambda: NFTSMC(alpha=5.0, beta=2.0, gamma=1.4, k1=10.0, k2=3.0, rho=0.714, eta=1.0, delta=0.1),
    SlidingMode(
        OneJoint(),
        Unconstrained(),
        # With δ = 1 the straight core of Ŝ^p is the linear term for all errors below 1.
        LinearCoreFixedTime(k1=5.0, k2=2.0, p=0.5, q=1.4, delta=1.0),
        TwoPowerReaching(k1=10.0, k2=3.0, v1=NEXT_TO_ONE, v2=0.714, layer=0.1),
        robust(1.0),
    ),
    sign=1.0,
    reach=1.0,
)
PAIRS = {
    "classical": CLASSICAL,
    "boundary_layer": BOUNDARY_LAYER,
    "fixed_time": FIXED_TIME,
    "nonsingular_fast_terminal": NONSINGULAR_FAST_TERMINAL,
}


def super_twisting(period: float) -> Pair:
    """The super-twisting law for one sampling period."""
    return Pair(
        lambda: ClassicalSMC(reaching=SuperTwistingReaching(k1=3.0, k2=2.2, dt=period), c=4.0),
        SuperTwisting(OneJoint(), Unconstrained(), Linear(4.0), k1=3.0, k2=2.2),
    )


GOAL, START, PUSH = 0.3, (-0.4, 0.5), 0.8
"""A set-point, a start and a constant disturbance for closed loops."""


def by_opensmc(pair: Pair, period: float, steps: int, method: str = "rk4", push: Any = PUSH) -> dict[str, np.ndarray]:
    """The closed loop by OpenSMC's own simulator."""
    # OpenSMC takes int(T/dt) steps; the additional half step prevents a loss by rounding.
    simulator = Simulator(dt=period, T=(steps + 0.5) * period, method=method)
    force = push if callable(push) else lambda t: push
    return simulator.run(
        pair.peer(),
        DoubleIntegrator(J=pair.inertia),
        ref_fn=lambda t: np.array([GOAL, 0.0]),
        dist_fn=lambda t: np.array([0.0, force(t)]),
        x0=np.array(START),
    )


def by_slidax(pair: Pair, period: float, steps: int, disturbance: Any = None, **options: Any) -> Any:
    """The same closed loop by `slidax.simulate`: the finished run."""
    return simulate(
        Plant(OneJoint(pair.inertia), disturbance or ConstantForce([PUSH])),
        pair.ours,
        ConstantPosture([GOAL]),
        State(q=jnp.array(START[:1]), dq=jnp.array(START[1:])),
        t1=steps * period,
        period=period,
        progress=False,
        **options,
    )


SAME = {"rtol": 1e-12, "atol": 1e-12}
STATES = 500


TERMINAL = peer_surfaces.TerminalSurface(beta=4.0, p=5, q=7)


def random_errors(reach, seed=0, least=0.0):
    """Random errors with `least < |e| < reach`, and random rates."""
    draw = np.random.default_rng(seed)
    e = draw.uniform(least, reach, STATES) * draw.choice([-1.0, 1.0], STATES)
    return e, draw.normal(0.0, 3.0, STATES)


@pytest.mark.parametrize(
    ("ours", "peer", "least", "reach"),
    [
        pytest.param(Linear(7.0), peer_surfaces.LinearSurface(c=7.0), 0.0, 3.0, id="linear"),
        # Zak's surface has no core: it equals slidax's outside the core, without the other power.
        pytest.param(LinearCoreFixedTime(4.0, NONE, 5 / 7, 2.0, 1e-2), TERMINAL, 1e-2, 3.0, id="terminal, linear core"),
        pytest.param(SmoothFixedTime(4.0, NONE, 5 / 7, 2.0, 1e-2), TERMINAL, 1e-2, 3.0, id="terminal, smooth core"),
        pytest.param(
            SingularityFree(4.0, NONE, 5 / 7, 2.0, 1.5, 1e-2), TERMINAL, 1e-2, 3.0, id="terminal, two-term core"
        ),
        pytest.param(
            LinearCoreFixedTime(2.0, 1.5, 0.5, 9 / 5, 1.0),
            peer_surfaces.FastTerminalSurface(alpha=2.0, beta=1.5, p=5, q=9),
            0.0,
            1.0,
            id="fast terminal",
        ),
    ],
)
def test_sliding_variables_agree_with_opensmc(ours, peer, least, reach):
    """At random errors for which slidax's surface is on the branch that OpenSMC implements.

    OpenSMC's fast terminal surface has the exponent q/p > 1; the one of Yu and Man (2002), which it cites, has an
    exponent below 1. Near zero the former is linear, so that the error decays exponentially there. The test compares it
    as implemented, with slidax's linear core plus the power above 1.
    """
    e, de = random_errors(reach, least=least)
    wanted = [peer.compute(float(a), float(b)) for a, b in zip(e, de, strict=True)]
    np.testing.assert_allclose(de + np.asarray(ours.phi_and_slope(jnp.asarray(e))[0]), wanted, **SAME)


@pytest.mark.parametrize(
    ("ours", "peer"),
    [
        pytest.param(
            lambda s: -6.0 * saturation(s, jnp.asarray(0.5)), peer_reaching.Saturation(k=6.0, phi=0.5), id="saturation"
        ),
        pytest.param(lambda s: -6.0 * saturation(s, jnp.asarray(0.0)), peer_reaching.ConstantRate(k=6.0), id="sign"),
        pytest.param(
            lambda s: -2.0 * saturation(s, jnp.asarray(0.0)) - 3.0 * s,
            peer_reaching.ExponentialRate(k=2.0, q=3.0),
            id="exponential",
        ),
        pytest.param(
            lambda s: -5.0 * sig(s, jnp.asarray(0.6)), peer_reaching.PowerRate(k=5.0, alpha=0.6), id="power below 1"
        ),
        pytest.param(
            lambda s: -FixedTimeReaching(5.0, 1.2).continuous_term(s),
            peer_reaching.PowerRate(k=5.0, alpha=1.2),
            id="power above 1",
        ),
        pytest.param(
            lambda s: -TwoPowerReaching(NONE, 5.0, 1.2, 0.6).continuous_term(s),
            peer_reaching.PowerRate(k=5.0, alpha=0.6),
            id="one of two powers",
        ),
    ],
)
def test_reaching_terms_agree_with_opensmc(ours, peer):
    s = np.concatenate([random_errors(3.0, seed=1)[0], [0.0, 0.5, -0.5]])
    np.testing.assert_allclose(np.asarray(ours(jnp.asarray(s))), [peer.compute(float(x)) for x in s], **SAME)


def states(pair, seed=2, least=1e-2):
    """Random states with their references, [5]: q, q̇, q_d, q̇_d, q̈_d."""
    e, de = random_errors(pair.reach, seed, least)
    qd, dqd, ddqd = np.random.default_rng(seed + 1).normal(0.0, 2.0, (3, STATES))
    return np.stack([qd + e, dqd + de, qd, dqd, ddqd if pair.accelerates else np.zeros(STATES)], axis=1)


@jax.jit
def answers_of_slidax(law, rows):
    def answer(row):
        state = State(q=row[0:1], dq=row[1:2])
        reference = Reference(q=row[2:3], dq=row[3:4], ddq=row[4:5])
        t = jnp.zeros(())
        command = law(t, state, reference, reference, law.init(t, state, reference))
        return jnp.stack([command.tau[0], command.signals["s"][0]])

    return jax.vmap(answer)(rows)


def answers_of_opensmc(pair, rows):
    law = pair.peer()
    both = (law.compute(0.0, row[:2], row[2:] if pair.accelerates else row[2:4]) for row in rows)
    return np.array([[float(u), pair.sign * float(info["s"])] for u, info in both])


@pytest.mark.parametrize("name", PAIRS)
def test_torques_and_sliding_variables_agree_with_opensmc(name):
    """At random states, to 1e-12.

    Differences between both formulas, and their treatment here:

    - ClassicalSMC: its code has `J (q̈_d + c ė)` for `e = x_ref - x`, as it must be; the head of its file prints the
      term in ė with the sign for `e = x - x_ref`. With a surface argument it omits that part, so the test passes no
      surface.
    - FixedTimeSMC and NFTSMC omit the reference acceleration; the laws agree for references without acceleration.
    - FixedTimeSMC cites Polyakov (2012), whose surface for the second-order plant is nonlinear. With the linear
      surface here the sliding variable is brought to zero within `T_max`; the error then decays exponentially.
    - NFTSMC adds 1e-15 to `|e|` before it takes the power γ - 1 < 1: a relative change of (γ - 1) 1e-15/|e|, which is
      below 1e-13 for the errors here, which exceed 0.01.
    """
    pair = PAIRS[name]
    rows = states(pair)
    np.testing.assert_allclose(
        np.asarray(answers_of_slidax(pair.ours, jnp.asarray(rows))), answers_of_opensmc(pair, rows), **SAME
    )


def test_the_nonsingular_law_differs_by_opensmcs_epsilon_at_zero_error():
    """`β γ (1e-15)^(γ-1) ė` with β = 2, γ = 1.4: slidax's slope is zero there."""
    pair, de = NONSINGULAR_FAST_TERMINAL, 1.5
    rows = np.array([[0.2, de, 0.2, 0.0, 0.0]])
    apart = np.asarray(answers_of_slidax(pair.ours, jnp.asarray(rows)))[0] - answers_of_opensmc(pair, rows)[0]
    assert apart[0] == pytest.approx(2.0 * 1.4 * 1e-15**0.4 * de, rel=1e-6)
    assert apart[1] == 0.0


STEPS = 3 * 1024
PERIOD = 1 / 1024
SHARP = {"classical": PAIRS["classical"], "fixed_time": PAIRS["fixed_time"], "super_twisting": super_twisting(PERIOD)}
SMOOTH = {name: PAIRS[name] for name in ("boundary_layer", "nonsingular_fast_terminal")}


def path(run):
    return np.concatenate([run.log.state.q, run.log.state.dq], axis=1)


def both_loops(pair):
    """Time, states, torque and sliding variable of all samples [samples 5], by OpenSMC and by slidax."""
    theirs = by_opensmc(pair, PERIOD, STEPS)
    run = by_slidax(pair, PERIOD, STEPS)
    assert run.outcome.ok and len(theirs["t"]) == STEPS + 1
    return (
        np.column_stack([theirs["t"], theirs["x"], theirs["u"], pair.sign * theirs["s"]]),
        np.column_stack([run.log.t, path(run), run.log.tau, run.log.signals["s"]]),
    )


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_loops_agree_at_every_sample(name):
    """Both hold the torque and move the plant by classical Runge-Kutta steps; 3 s, 3072 steps.

    The reference is a set-point, since OpenSMC's simulator passes no reference acceleration to the law.
    """
    theirs, ours = both_loops(SMOOTH[name])
    np.testing.assert_allclose(ours, theirs, **SAME)
    assert abs(ours[-1, 1] - GOAL) < 0.03 * abs(START[0] - GOAL)


@pytest.mark.parametrize("name", SHARP)
def test_discontinuous_loops_agree_until_the_surface_and_stay_close_after(name):
    """On the surface, rounding can flip a sign, and so the torque of a whole period."""
    theirs, ours = both_loops(SHARP[name])
    reached = int(np.argmax(np.abs(theirs[:, 4]) < 0.02))
    assert 0 < reached < STEPS // 2
    np.testing.assert_allclose(ours[:reached], theirs[:reached], **SAME)
    np.testing.assert_allclose(ours[:, 1:3], theirs[:, 1:3], rtol=0, atol=10 * PERIOD)


def apart(pair, steps, method="rk4", push=PUSH, disturbance=None, **options):
    """Largest difference between the two loops in 1 s."""
    theirs = by_opensmc(pair, 1 / steps, steps, method, push)
    return np.abs(path(by_slidax(pair, 1 / steps, steps, disturbance, **options)) - theirs["x"]).max()


FREQUENCY = 2 * np.pi
OTHERWISE = {
    "explicit Euler, semi-implicit Euler": {"method": "euler", "integrator": semi_implicit_euler},
    "torque held, law in every stage": {"mode": "continuous"},
    "disturbance held, disturbance in every stage": {
        "push": lambda t: 2.0 * np.sin(FREQUENCY * t),
        "disturbance": Harmonic([2.0], [FREQUENCY]),
    },
}


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("how", OTHERWISE)
def test_difference_of_stepping_schemes_vanishes_at_first_order(name, how):
    """Both approximate one solution; OpenSMC's Euler step is explicit, its law sampled, its disturbance held."""
    differences = [apart(SMOOTH[name], steps, **OTHERWISE[how]) for steps in (256, 512, 1024)]
    assert np.log2(np.divide(differences[:-1], differences[1:])) == pytest.approx([1.0] * 2, abs=0.1)
    assert 1e-5 < differences[-1] < 2e-2


def test_opensmcs_fixed_time_bound_holds_for_slidaxs_reaching_law():
    """`1/(α (1-p)) + 1/(β (q-1))`, from starts up to 10^6 away, without a disturbance.

    OpenSMC states it as a settling time, but only the sliding variable has settled by then, see above.
    """
    law = FIXED_TIME.peer()
    reaching = FIXED_TIME.ours.reaching
    bound = 1.0 / (law.alpha * (1.0 - law.p)) + 1.0 / (law.beta * (law.q - 1.0))
    assert law.T_max == pytest.approx(bound, rel=1e-15)
    far, near = 1e6, 1e-6
    s = np.geomspace(near, far, 20_001)
    # ds/dt = -power(s): the time from far to near is the integral of ds/power(s), in log s by the trapezoid rule.
    ours = s / np.asarray(reaching.continuous_term(jnp.asarray(s)))
    time = float(np.sum(0.5 * (ours[1:] + ours[:-1]) * np.diff(np.log(s))))
    assert 0.5 * bound < time < bound
    assert float(np.exp(-4.0 * bound)) > near  # on the surface, the error decays as exp(-c t): not settled by then
