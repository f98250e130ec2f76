"""Put a closed loop together from parts: an arm, a motion through waypoints, friction and a push, and the law.

Usage: python examples/02_build_by_hand.py
"""

import slidax as sx
from slidax.arms import TwoLink
from slidax.law import FixedTime, UncertaintyBound, cftsmppc
from slidax.motions import MinimumJerk
from slidax.plant import Friction, Step

true = TwoLink(lengths=[1.0, 0.8], masses=[0.5, 1.5], inertias=[5.0, 5.0])
nominal = TwoLink(lengths=[1.0, 0.8], masses=[0.6, 1.8], inertias=[6.0, 6.0])

controller = cftsmppc(
    nominal,
    performance=FixedTime(initial=0.4, final=0.005, deadline=2.0, exponent=2.01),
    overshoot=0.3,
    bound=UncertaintyBound(0.09, 0.2, b0=12.0, b1=2.2, b2=2.8, margin=1.0),
)
run = sx.simulate(
    sx.Plant(true, Friction(coulomb=[2.0, 1.0], viscous=0.5) + Step([0.0, 5.0], start=3.0, end=4.0)),
    controller,
    MinimumJerk.through(times=[0.0, 2.0, 5.0], waypoints=[[0.0, 1.0], [0.8, 0.2], [0.3, 1.2]]),
    sx.State(q=[0.2, 0.8]),
    t1=6.0,
    period=1e-4,
    log_every=10,
)
print(run)
