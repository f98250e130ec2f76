"""The sampled loop of a two-link arm at 1 kHz as a linear system: eigenvalues, margins, a step response.

Usage: python examples/07_margins_of_the_loop.py
"""

import numpy as np

import slidax as sx
from slidax.analysis import linearise

scenario = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 5.0})
loop = linearise(scenario)
print(f"spectral radius {loop.system.radius:.4f},", "stable" if loop.stable else "not stable")
for note in loop.notes:
    print("note:", note)

for where in ("torque", "measurement"):
    for joint in loop.margins(where):
        print(f"{joint.where}: gain up to {joint.gain_up:.3g}, phase {joint.phase:.3g} degrees, ", end="")
        print(f"delay {1e3 * joint.delay:.3g} ms, disk {joint.disk:.3g}, peak of S {joint.sensitivity:.3g}")

# Error of joint 1 under a constant disturbance of 1 N m on it.
times, error = loop.system.select("disturbance[joint 1]", "error[joint 1]").step_response(0.3)
print(f"a push of 1 N m moves joint 1 by {np.abs(error).max():.2e} rad, and in the end by {error[-1, 0, 0]:.1e} rad")
