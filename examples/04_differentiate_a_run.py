"""Differentiate a whole closed loop: how the tracking error changes with each gain of the surface.

Usage: python examples/04_differentiate_a_run.py
"""

import equinox as eqx
import jax.numpy as jnp

import slidax as sx

scenario = sx.scenarios.load("example-4.2").replace(t1=1.0, period=2e-4, mode="held")


def loop(surface):
    """The closed loop with another surface."""
    controller = eqx.tree_at(lambda c: c.surface, scenario.controller, surface)
    return scenario.replace(controller=controller).parts


def mean_square_error(run):
    """The mean square error over the run."""
    return jnp.mean(run.log.e**2)


value, gradient = sx.simulation.value_and_gradient(
    mean_square_error, loop, scenario.controller.surface, t1=scenario.t1, stepping=scenario.stepping, log_every=1
)
print(f"mean square error: {value:.6f}")
for name in ("k1", "k2", "p", "q", "delta"):
    print(f"  change per unit of {name:<5}: {getattr(gradient, name):+.4f}")
