"""Payloads on a seven-joint arm, which its law knows nothing of, as one batch.

Usage: python examples/05_payloads_on_an_arm.py
"""

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import slidax as sx
from slidax.robots import Load, Mismatch, Payload

scenario = sx.scenarios.load("panda-payload", {"simulation.t1": 3.0})
nominal = scenario.controller.nominal
print(f"{nominal.name}: {', '.join(nominal.joint_names)}")


def define(mass):
    """The plant with another payload; everything else is the scenario's."""
    load = Load(Payload(mass=mass, center=jnp.asarray([0.0, 0.0, 0.1]), inertia=2e-3 * mass))
    mismatch = Mismatch(mass_factor=0.85, coulomb=0.3, viscous=0.2, load=load)
    plant = eqx.tree_at(
        lambda plant: (plant.robot, plant.load), scenario.plant, (mismatch.applied(nominal), mismatch.load)
    )
    return plant, scenario.controller, scenario.trajectory, scenario.state0


masses = np.array([0.0, 1.0, 2.0, 4.0, 6.0])
runs = sx.simulate_batch(
    define,
    masses,
    t1=scenario.t1,
    period=scenario.period,
    integrator=scenario.integrator,
    substeps=scenario.substeps,
    outside=scenario.outside,
)
for mass, outside, margin, error in zip(
    masses, runs.tally.violations, runs.tally.margin, runs.tally.steady_error, strict=True
):
    print(
        f"{mass:.0f} kg: {int(outside):3} outside, margin {np.min(margin):5.2f}, steady error {np.max(error):.0e} rad"
    )
