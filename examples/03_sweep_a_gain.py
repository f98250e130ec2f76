"""Sweep a gain: 64 closed loops at once, compiled once, since every gain is an array leaf.

Usage: python examples/03_sweep_a_gain.py
"""

import equinox as eqx
import jax.numpy as jnp

import slidax as sx

scenario = sx.scenarios.load("example-4.1").replace(t1=2.0)


def define(scenario, k1):
    """The scenario with one gain of the surface."""
    return scenario.replace(controller=eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1))


gains = jnp.linspace(0.05, 0.5, 64)
runs = scenario.simulate_batch(define, gains)
print(runs)
print("   k1   error [rad]   peak torque [N m]   outcome")
for k1, run in list(zip(gains, runs, strict=True))[::9]:
    error, peak = sx.analysis.steady_error(run).max(), sx.analysis.peak_torque(run).max()
    print(f"{k1:5.3f}   {error:11.2e}   {peak:17.1f}   {run.outcome.kind}")
