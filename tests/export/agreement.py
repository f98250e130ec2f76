"""How C is compared with Python: over random states and random gains."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.export.golden_samples import answer, random_samples
from slidax.law import SampledData
from slidax.law.implicit_steps import PRECISION
from slidax.scenarios import load

from .exported import Exported

SAMPLES, EXAMPLES = 2500, 4
"""10 000 random states for each pair."""

TOLERANCE = 1e-12
NO_LIMITS = {"actuator": {}}

Pair = tuple[str, str, dict]
"""A scenario with an arm, a scheme, and what else is changed."""


COMPOSED = {
    "name": "sliding_mode",
    "transformation": {"kind": "unconstrained"},
    "surface": {"kind": "linear", "rate": 5.0},
    "reaching": {"kind": "fixed_time", "gain": 0.1, "exponent": 1.2, "layer": 0.05},
    "bound": {"kind": "fixed", "size": 30.0},
}
"""The scheme that has no parts of its own, of parts that no other has together."""


def in_full(pairs: list[Pair], *always: str) -> list:
    """All pairs for `make verify`, and for every day those with the schemes that are named, in their order, by turns.

    - `pairs`: arms and schemes.
    - `always`: for each arm in turn, the scheme that is compared every day.
    """
    arms = list(dict.fromkeys(arm for arm, *_ in pairs))
    daily = set(zip(arms, always, strict=True))
    return [pair if pair[:2] in daily else pytest.param(pair, marks=pytest.mark.full) for pair in pairs]


def named(pair: Pair) -> str:
    """What a test of a pair is called."""
    arm, scheme, limits = pair
    return f"{scheme}, {arm}{', no limits' if limits else ''}"


def slack(guard, samples):
    """What a law that searches for a plan may be off by: its plan is found to so many rad/s, over one horizon."""
    law = guard.controller
    if not isinstance(law, SampledData) or law.horizon is None:
        return 0.0
    stiffness = np.abs(jax.vmap(law.nominal.mass)(samples.state.q)).sum(-1).max(-1)
    return 2.0 * PRECISION * stiffness / float(law.horizon)


def agree(pair: Pair, folder: Path) -> None:
    """Fails unless the torque of C is that of Python, the status, too, and a repeated call gives the same bits."""
    arm, scheme, changes = pair
    if scheme == COMPOSED["name"]:
        sampled = {"sampled_data": {}} if arm.endswith("khz") else {}
        scenario = load(arm, {"scheme": COMPOSED | sampled, **changes})
    else:
        scenario = load(arm, {"scheme.name": scheme, **changes})
    exported = Exported(scenario, folder)
    leaves, tree = jax.tree.flatten(exported.project.guard)

    @settings(max_examples=EXAMPLES)
    @given(st.integers(0, 2**31), st.integers(0, len(leaves) - 1), st.floats(0.95, 1.05))
    def compare(seed, which, factor):
        guard = jax.tree.unflatten(tree, [leaf * (factor if k == which else 1.0) for k, leaf in enumerate(leaves)])
        samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, SAMPLES, seed=seed)
        command, status = answer(guard, samples)
        parameters = exported.parameters(guard)
        found = exported.answers(samples, parameters)
        np.testing.assert_array_equal(found.status, status)
        off = np.abs(found.command["tau"] - command.tau).max(1)
        size = np.abs(np.asarray(command.tau)).max(1)
        assert np.all(off <= TOLERANCE * size + slack(guard, samples)), (off / size).max()
        again = exported.answers(samples, parameters)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(found, again, strict=True))

    compare()
