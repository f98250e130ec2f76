"""Sweep a gain: 64 closed loops at once, compiled once, since every gain is an array leaf.

Usage: python examples/03_sweep_a_gain.py
"""

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp

import slidax as sx

scenario = sx.scenarios.load("example-4.1")


@eqx.filter_jit
@eqx.filter_vmap
def steady_error_and_peak(k1):
    """The worst steady error and the highest torque for one gain of the surface."""
    controller = eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1)
    parts = (scenario.plant, controller, scenario.trajectory, scenario.state0)
    run = sx.simulate(*parts, t1=2.0, period=scenario.period, log_every=None)
    return run.tally.steady_error.max(), run.tally.peak_torque.max(), run.fault.absent


gains = jnp.linspace(0.05, 0.5, 64)
errors, peaks, kept = steady_error_and_peak(gains)
print("   k1   error [rad]   peak torque [N m]   inside")
for k1, error, peak, inside in list(zip(gains, errors, peaks, kept, strict=True))[::9]:
    print(f"{k1:5.3f}   {error:11.2e}   {peak:17.1f}   {'yes' if inside else 'no'}")
