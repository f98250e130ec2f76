"""A scenario with a constant inertia, for certificates of the printed law."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.scenarios import Scenario, load

INERTIA = 6.0


def constant(seed: int, **changes: Any) -> Scenario:
    """A law that meets all assumptions: M0 = M = 6 I, the unit vector, continuous time, a bounded disturbance.

    - `seed`: of gains, envelope, start and disturbance.
    - `changes`: on top, by path.
    """
    rng = np.random.default_rng(seed)
    radius = float(rng.uniform(0.3, 1.5))
    sign = rng.choice([-1.0, 1.0], 2)
    error = sign * radius * rng.uniform(1e-3, 0.95, 2)
    arm = {"lengths": [1.0, 1e-13], "masses": [0.5, 0.5], "inertias": [INERTIA - 1.0, INERTIA]}
    changes_of_seed = {
        "robot": {"kind": "two_link", "plant": arm, "nominal": {}},
        "trajectory": {"kind": "sinusoid", "offset": [0.0, 0.5], "amplitude": [0.3, 0.2], "frequency": [1.0, 1.5]},
        "disturbance.terms": [{"kind": "harmonic", "amplitude": rng.uniform(0, 3, 2).tolist(), "frequency": 3.0}],
        "start.q": [float(error[0]), float(0.5 + error[1])],
        "start.dq": rng.uniform(-0.5, 0.5, 2).tolist(),
        "scheme.performance": {
            "kind": "fixed_time",
            "initial": radius,
            "final": float(radius * rng.uniform(0.02, 0.2)),
            "deadline": float(rng.uniform(0.5, 2.0)),
            "exponent": float(rng.uniform(2.01, 3.0)),
        },
        "scheme.overshoot": float(rng.uniform(0.1, 0.9)),
        "scheme.surface": {
            "k1": float(rng.uniform(0.1, 0.6)),
            "k2": float(rng.uniform(0.2, 1.0)),
            "p": float(rng.uniform(0.3, 0.8)),
            "q": float(rng.uniform(1.1, 1.8)),
            "delta": float(rng.uniform(0.05, 0.3)),
        },
        "scheme.reaching": {
            "gain": float(rng.uniform(0.1, 5.0)),
            "exponent": float(rng.uniform(1.1, 1.8)),
            "layer": 0.0,
        },
        "scheme.bound": {
            "inverse_inertia_min": 1.0 / INERTIA,
            "inverse_inertia_max": 1.0 / INERTIA,
            "b0": 5.0,
            "b1": 0.0,
            "b2": 0.0,
            "margin": float(rng.uniform(1.0, 4.0)),
        },
        "simulation": {"mode": "continuous", "period": 1e-4, "t1": 12.0, "log_every": 10},
    }
    return load("example-4.1", {**changes_of_seed, **changes})
