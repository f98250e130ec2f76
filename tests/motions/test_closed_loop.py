"""Piecewise motions in a closed loop: the native and the XLA engine give the same runs."""

import numpy as np
import pytest

from slidax.motions import MinimumJerk, Tabulated, Trapezoidal
from slidax.simulation import simulate
from tests.enrolled import every
from tests.paper_examples import START_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

PATH = [[-0.4, 2.5], [0.2, 2.0], [0.1, 2.2]]
ROWS = np.linspace(0.0, 0.5, 400)
MOTIONS = [
    ("quintic", MinimumJerk.within(PATH, velocity=4.0, acceleration=30.0)),
    ("trapezoidal", Trapezoidal.through(PATH, velocity=4.0, acceleration=30.0)),
    ("s_curve", Trapezoidal.through(PATH, velocity=4.0, acceleration=30.0, jerk=1000.0, start=0.05)),
    ("cubics", Tabulated.through([0.0, 0.3, 0.6], PATH, [[0.0, 0.0], [0.5, 0.2], [0.0, 0.0]])),
    ("long table", Tabulated.through(ROWS, np.outer(np.sin(np.pi * ROWS / 0.5) ** 2, [0.1, -0.2]) + PATH[0])),
]


# Same classes as other members, with other numbers.
LIKE_OTHERS = ("trapezoidal", "cubics")


@every("motion", MOTIONS, full=LIKE_OTHERS)
def test_both_engines_follow_the_same_motion(motion):
    native, xla = (
        simulate(SMOOTH_PLANT, SPRING, motion, START_4_1, t1=0.8, period=2e-3, log_every=5, engine=engine)
        for engine in ("native", "xla")
    )
    assert native.outcome.ok
    for part in ("q", "dq", "ddq"):
        ours, theirs = getattr(native.log.reference, part), getattr(xla.log.reference, part)
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=1e-11)
    # The motion is followed to its end, where it stands still.
    np.testing.assert_allclose(native.log.reference.q[-1], np.asarray(motion.position(motion.until)), atol=1e-14)
    assert np.all(np.asarray(native.log.reference.dq[-1]) == 0.0)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_a_sample_at_a_knot_has_the_acceleration_of_the_following_piece(engine):
    """Speeding up for half a second and slowing down for another, with samples exactly at 0, 0.5 and 1."""
    motion = Trapezoidal.through([[0.0, 0.0], [0.5, -0.5]], velocity=10.0, acceleration=2.0)
    run = simulate(SMOOTH_PLANT, SPRING, motion, START_4_1, t1=1.5, period=0.125, log_every=1, engine=engine)
    acceleration = np.asarray(run.log.reference.ddq[:, 0])
    np.testing.assert_allclose(acceleration, [2.0] * 4 + [-2.0] * 4 + [0.0] * 5, atol=1e-12)
