"""Differentiate a whole closed loop: how the tracking error changes with each gain of the surface.

Usage: python examples/04_differentiate_a_run.py
"""

import slidax as sx

changes = {"simulation.t1": 1.0, "simulation.period": 2e-4, "simulation.mode": "held"}
scenario = sx.scenarios.load("example-4.2", changes)
gains = [f"scheme.surface.{name}" for name in ("k1", "k2", "p", "q")]
value, slopes = scenario.grad("rms_error", gains)
print(f"error of the worst joint, root mean square: {value:.6f}")
for path, slope in slopes.items():
    print(f"  change per unit of {path}: {slope:+.4f}")
