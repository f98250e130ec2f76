"""Run a built-in scenario, read its metrics, draw its error inside the envelope.

Usage: python examples/01_run_a_scenario.py [FIGURE.svg]
"""

import sys

import jax

jax.config.update("jax_enable_x64", True)

import slidax as sx

scenario = sx.scenarios.load("example-4.1")
run = scenario.simulate()

print(run.outcome.message)
for joint in range(run.joints):
    settled = sx.metrics.settling_time(run, 1e-3)[joint]
    left = sx.metrics.steady_error(run)[joint]
    print(f"joint {joint + 1}: within 1e-3 rad after {settled:.3f} s, then within {left:.2g} rad")

sx.figures.tracking_error(run).savefig(sys.argv[1] if len(sys.argv) > 1 else "tracking_error.svg")
