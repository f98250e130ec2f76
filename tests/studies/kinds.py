"""Small studies of one family, so that its loop is compiled once for all of them."""

from slidax.studies import RunOptions, study_of

UNCERTAIN = {
    "robot.plant.masses": {"around": "20 %"},
    "robot.plant.inertias": {"around": "20 %", "each": "joint"},
    "disturbance.scale": {"between": [0.0, 1.2]},
    "start.q": {"around": 0.06, "each": "joint"},
}

SHORT = {"simulation.t1": 0.5, "simulation.substeps": 1, "simulation.log_every": 1}

WEAK = {
    "robot.plant.masses": {"around": "20 %", "each": "joint"},
    "robot.plant.inertias": {"around": "20 %", "each": "joint"},
    "robot.plant.lengths": {"around": "10 %", "each": "joint"},
    "disturbance.scale": {"between": [0.0, 1.2]},
    "start.q": {"around": 0.06, "each": "joint"},
    "start.dq": {"between": [-0.03, 0.03], "each": "joint"},
}
"""Of an arm whose drives may be too weak: where its second link is short, its masses are large, its start is low."""


def found(kind, **text):
    return asked(kind, **text).run(RunOptions())


def asked(kind, **text):
    common = {"scenario": "example-4.1-1khz", "changes": SHORT, "uncertainty": UNCERTAIN}
    return study_of({**common, "study": kind, **text})


def weak(kind, torque, **text):
    changes = {"simulation.t1": 3.0, "simulation.substeps": 2, "actuator.torque": torque}
    return found(kind, changes=changes, uncertainty=WEAK, **text)
