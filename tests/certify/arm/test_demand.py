"""The demand of a set bounds every member, on the reference and near it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from slidax.certify.arm import compute_demand
from slidax.certify.arm.demand import Demand
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
def test_demand_bounds_every_member(name):
    base, uncertainty, changes = (SETS | SLOW)[name]
    scenario, family = with_set(load(base), uncertainty, changes)
    bounds = compute_demand(scenario, family)
    exact_demand = asked_by(scenario)
    random = np.random.default_rng(5)
    shape = bounds.disturbance.shape[1:]
    radius, speed = 1e-3 * random.uniform(0.1, 3.0, shape[1]), 1e-2 * random.uniform(0.1, 3.0, shape[1])
    room = bounds.deviation(radius, speed)
    assert np.isfinite(room).all()
    # A signal that lies in the hull does so in every direction; the filters are drawn at random.
    filters = random.normal(size=(10, 30))
    still = np.zeros(shape)
    close = 0.0
    for seed in range(5 if name in SETS else 20):
        plant = member(family, seed)
        exact = np.asarray(exact_demand(plant, bounds.times, still, still))
        for weights in filters:

            def through(w, weights=weights):
                return lfilter(weights, 1.0, w, axis=-2)

            limit = bounds.worst(through)
            answer = np.abs(through(exact))
            assert (answer <= limit * (1 + 1e-7) + 1e-9).all()
            close = max(close, float((answer / limit).max()))
        for _ in range(3):
            e, de = (size * random.choice([-1.0, 1.0, 0.3], size=shape) for size in (radius, speed))
            moved = np.abs(np.asarray(exact_demand(plant, bounds.times, e, de)) - exact)
            assert (moved <= room).all()
    assert close > 0.5


def test_boxed_demand_covers_every_member_of_the_set():
    rng = np.random.default_rng(0)
    push, effects = rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 4, 5, 3))
    kappa, coupling = np.ones((2, 3)), np.zeros((3, 3))
    whole = Demand(np.arange(5.0), push, np.full((5, 3), 0.1), kappa, coupling, [], effects=effects)
    boxed = whole.boxed()
    assert boxed.effects is None
    for _ in range(100):
        share, x = rng.dirichlet([1.0, 1.0]), rng.choice([-1.0, 1.0], 4)
        disturbance = np.einsum("m,mkj->kj", share, push + np.einsum("e,mekj->mkj", x, effects))
        middle = np.einsum("m,mkj->kj", share, push)
        assert (np.abs(disturbance - middle) + 0.1 <= boxed.stray + 1e-12).all()
    assert boxed.boxed() is boxed
