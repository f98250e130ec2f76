"""`admissibility`: starts drawn from random sets, and parameters outside their ranges."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.certify import admissibility
from slidax.certify.uncertainty_set import family_of
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import FixedTime, FixedTimeReaching, PrescribedPerformance, SmoothFixedTime, UncertaintyBound
from slidax.scenarios import load

from .continuous import law_of, scenario_of
from .counted import Counted

ARMS = {2: "example-4.1", 3: "example-4.2", 6: "ur5e-payload", 7: "panda-payload"}
"""Scenarios by their number of joints; other arms have one start each."""


def judged(seed: int, sets: int, draws: int, joints: int, count: Counted) -> None:
    """Count starts of random sets by the error over the envelope, if all of the set should be inside."""
    for number in range(sets):
        rng = np.random.default_rng([seed, joints, number])
        verdict, shares = (_of_a_set if joints in ARMS else _of_one)(rng, joints, draws)
        outside = shares >= 1.0
        if verdict.holds:
            count.kept(shares, joints, f"set {number}, {joints} joints", slack=0.0)
            count.missed += int(outside.sum())
        else:
            named = [line.text for line in verdict.assumptions if line.status == "fails"]
            assert any("outside the envelope" in text for text in named), named
            count.refused += int(outside.sum())


def _of_a_set(rng: np.random.Generator, joints: int, draws: int) -> tuple[Any, np.ndarray]:
    base = load(ARMS[joints], {"simulation.t1": 0.1})
    own = np.asarray(base.state0.q, float)
    reference = np.asarray(base.trajectory.reference(jnp.zeros(())).q)
    initial = np.asarray(base.controller.transformation.performance.initial if joints < 6 else
                         base.controller.step.transformation.performance.initial) * np.ones(joints)  # fmt: skip
    room = initial - np.abs(own - reference)
    wide = float(np.min(room)) * 10 ** rng.uniform(-2.0, 0.4)
    centre = own + wide * rng.uniform(-0.3, 0.3, joints)
    kind = rng.integers(4)
    if kind == 0:
        uncertainty: dict[str, Any] = {"around": wide, "each": "joint"}
    elif kind == 1:
        uncertainty = {"ball": wide}
    elif kind == 2:
        uncertainty = {"between": [(centre - wide).tolist(), (centre + wide).tolist()], "each": "joint"}
    else:
        uncertainty = {"choice": (centre + wide * rng.uniform(-1.0, 1.0, (5, joints))).tolist()}
    scenario = load(ARMS[joints], {"simulation.t1": 0.1, "uncertainty": {"start.q": uncertainty}})
    space = family_of(scenario).space
    cube = rng.uniform(size=(draws, space.dimensions))
    cube[::2] = np.where(cube[::2] < 0.5, 0.0, np.nextafter(1.0, 0.0))
    starts = space.values(cube)["start.q"]
    return admissibility(scenario), np.max(np.abs(starts - reference) / initial, axis=1)


def _of_one(rng: np.random.Generator, joints: int, _: int) -> tuple[Any, np.ndarray]:
    law = law_of(rng, joints, layered=True)
    initial = np.asarray(law.transformation.performance.initial)
    share = 10 ** rng.uniform(-6.0, 0.1, joints)
    start = State(q=rng.choice([-1.0, 1.0], joints) * share * initial, dq=np.zeros(joints))
    return admissibility(scenario_of(law, start, np.zeros((1, joints)))), np.array([share.max()])


def parameters(rng: np.random.Generator) -> dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
    """Components with values in their ranges, and values outside them, by name."""
    u = lambda low, high: float(rng.uniform(low, high))  # noqa: E731
    positive = lambda: float(10 ** rng.uniform(-6.0, 2.0))  # noqa: E731
    final = u(1e-4, 0.1)
    envelope = {"initial": final + positive(), "final": final, "deadline": positive(), "exponent": 2.0 + positive()}
    surface = {"k1": positive(), "k2": positive(), "p": u(0.01, 0.99), "q": 1.0 + positive(), "delta": u(1e-6, 1.0)}
    reaching = {"gain": positive(), "exponent": 1.0 + positive(), "layer": positive()}
    least = positive()
    bound = {"inverse_inertia_min": least, "inverse_inertia_max": least + positive()}
    bound |= {"b0": positive(), "b1": positive(), "b2": positive(), "margin": positive()}
    none = rng.choice([0.0, -1.0]) * positive()
    return {
        "20": (FixedTime, envelope, {"initial": final - u(0.0, 1.0) * final, "final": none, "deadline": none,
                                     "exponent": 2.0 - rng.choice([0.0, positive()])}),
        "13": (lambda **values: PrescribedPerformance(FixedTime(**envelope), **values), {"overshoot": u(0.01, 0.99)},
               {"overshoot": rng.choice([none, 1.0 + rng.choice([0.0, positive()])])}),
        "29": (SmoothFixedTime, surface, {"k1": none, "k2": none, "p": rng.choice([none, 1.0 + positive(), 1.0]),
                                          "q": 1.0 - rng.choice([0.0, positive()]),
                                          "delta": rng.choice([none, 1.0 + positive()])}),
        "43": (FixedTimeReaching, reaching, {"gain": none, "exponent": 1.0 - rng.choice([0.0, positive()]),
                                             "layer": -positive()}),
        "45": (UncertaintyBound, bound, {"b0": -positive(), "b1": -positive(), "b2": -positive(), "margin": none,
                                         "inverse_inertia_min": rng.choice([none, least + 200.0])}),
    }  # fmt: skip


def judged_parameters(seed: int, draws: int, count: Counted) -> None:
    """Count components with values in their ranges, and ones with a value outside, which must be refused."""
    for number in range(draws):
        rng = np.random.default_rng([seed, number])
        for make, good, bad in parameters(rng).values():
            make(**good)
            name = str(rng.choice(list(bad)))
            try:
                make(**{**good, name: bad[name]})
            except DefinitionError:
                count.refused += 1
            else:
                count.missed += 1
                count.notes.append(f"draw {number}: {name} = {bad[name]} was taken")
