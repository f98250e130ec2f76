"""Run a built-in scenario, read its metrics, draw its error inside the envelope.

Usage: python examples/01_run_a_scenario.py [FIGURE.svg]
"""

import sys

import slidax as sx

scenario = sx.scenarios.load("example-4.1")
run = scenario.simulate()

print(scenario.controller)
print(run)
print("settled to 1e-5 rad after [s]:", sx.analysis.settling_time(run, 1e-5))

sx.report.figures.save(
    sx.report.figures.tracking_error(run), sys.argv[1] if len(sys.argv) > 1 else "tracking_error.svg"
)
