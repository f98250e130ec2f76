"""What a set asks of the loops holds for every member of it, on the reference and beside it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from slidax.certificates.arm import compute_demand
from slidax.scenarios import load

from .sets import asked_by, member, with_set

SETS = {
    "two links": (
        "example-4.1-1khz",
        {
            "robot.plant.masses": {"around": "20 %", "each": "entry"},
            "robot.plant.lengths": {"around": "5 %", "each": "entry"},
            "robot.plant.gravity_acceleration": {"between": [9.7, 9.9]},
            "disturbance.scale": {"between": [0, 1]},
            "start": {"inside": "envelope"},
        },
        {"simulation.t1": 0.3},
    ),
    "scara": (
        "example-4.2-1khz",
        {"robot.plant.masses": {"around": "20 %"}, "disturbance.scale": {"between": [0.5, 1.5]}},
        {"simulation.t1": 0.3},
    ),
}

SLOW = {
    "panda": (
        "panda-payload",
        {
            "robot.plant.load.mass": {"between": [0, 3]},
            "robot.plant.load.center": {"ball": 0.05},
            "robot.plant.mass_factor": {"around": "20 %"},
            "robot.plant.coulomb": {"between": [0.1, 0.5], "each": "joint"},
            "robot.plant.armature": {"between": [0.05, 0.2], "distribution": "log_uniform"},
        },
        {"robot.plant.load.inertia": 0, "simulation.t1": 2.0},
    ),
    "ur5e": (
        "ur5e-payload",
        {"robot.plant.load.mass": {"between": [0, 3]}, "robot.plant.viscous": {"between": [0, 1], "each": "joint"}},
        {"robot.plant.load.inertia": 0, "simulation.t1": 2.0},
    ),
}

ALL = [pytest.param(name, id=name) for name in SETS] + [
    pytest.param(name, id=name, marks=pytest.mark.full) for name in SLOW
]


@pytest.mark.parametrize("name", ALL)
def test_no_member_asks_for_more_than_the_demand_says(name):
    base, uncertainty, changes = (SETS | SLOW)[name]
    scenario, family = with_set(load(base), uncertainty, changes)
    found = compute_demand(scenario, family)
    asked = asked_by(scenario)
    random = np.random.default_rng(5)
    shape = found.push.shape[1:]
    radius, speed = 1e-3 * random.uniform(0.1, 3.0, shape[1]), 1e-2 * random.uniform(0.1, 3.0, shape[1])
    room = found.deviation(radius, speed)
    assert np.isfinite(room).all()
    # A signal that lies in the hull does so in every direction; the filters are drawn at random.
    filters = random.normal(size=(10, 30))
    still = np.zeros(shape)
    close = 0.0
    for seed in range(5 if name in SETS else 20):
        plant = member(family, seed)
        exact = np.asarray(asked(plant, found.times, still, still))
        for weights in filters:

            def through(w, weights=weights):
                return lfilter(weights, 1.0, w, axis=-2)

            limit = found.worst(through)
            answer = np.abs(through(exact))
            assert (answer <= limit * (1 + 1e-7) + 1e-9).all()
            close = max(close, float((answer / limit).max()))
        for _ in range(3):
            e, de = (size * random.choice([-1.0, 1.0, 0.3], size=shape) for size in (radius, speed))
            moved = np.abs(np.asarray(asked(plant, found.times, e, de)) - exact)
            assert (moved <= room).all()
    assert close > 0.5
