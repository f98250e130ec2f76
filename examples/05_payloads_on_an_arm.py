"""Payloads on a seven-joint arm, which its law knows nothing of, as one batch.

Usage: python examples/05_payloads_on_an_arm.py
"""

import equinox as eqx
import numpy as np

import slidax as sx
from slidax.arms import Mismatch, Payload, TimedPayload

scenario = sx.scenarios.load("panda-payload", {"simulation.t1": 3.0})
nominal = scenario.controller.nominal
print(f"{nominal.name}: {', '.join(nominal.joint_names)}")


def define(scenario, mass):
    """The scenario with another payload."""
    load = TimedPayload(Payload(mass=mass, center=[0.0, 0.0, 0.1], inertia=2e-3 * mass))
    mismatch = Mismatch(mass_factor=0.85, coulomb=0.3, viscous=0.2, load=load)
    true = (mismatch.applied(nominal), mismatch.load)
    return scenario.replace(plant=eqx.tree_at(lambda plant: (plant.robot, plant.load), scenario.plant, true))


masses = np.array([0.0, 1.0, 2.0, 4.0, 6.0])
for mass, run in zip(masses, scenario.simulate_batch(define, masses), strict=True):
    outside, margin = sx.analysis.envelope_violations(run), sx.analysis.envelope_margin(run).min()
    error = sx.analysis.steady_error(run).max()
    print(f"{mass:.0f} kg: {outside:3} outside, margin {margin:5.2f}, steady error {error:.0e} rad")
