"""Sweep a gain: 64 closed loops at once, compiled once.

Usage: python examples/03_sweep_a_gain.py
"""

import numpy as np

import slidax as sx

gains = np.linspace(0.05, 0.5, 64)
runs = sx.scenarios.load("example-4.1", {"simulation.t1": 2.0}).sweep({"scheme.surface.k1": gains})
print(runs)
print("   k1   error [rad]   peak torque [N m]   outcome")
for k1, run in list(zip(gains, runs, strict=True))[::9]:
    error, peak = sx.metrics.steady_error(run).max(), sx.metrics.peak_torque(run).max()
    print(f"{k1:5.3f}   {error:11.2e}   {peak:17.1f}   {run.outcome.kind}")
