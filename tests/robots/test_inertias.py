"""The nearest inertia that a body can have, and the files that need it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from slidax._errors import DefinitionError, DefinitionWarning
from slidax.robots import from_mjcf, from_urdf
from slidax.robots.files.inertias import Feasible
from slidax.robots.inertia import is_rigid, nearest_rigid
from tests.robots import bad_mjcf, bad_urdf
from tests.robots.bad_file import changed
from tests.robots.bad_urdf import FLAT_TOOL, GOOD, INERTIA, TOOL, inertia
from tests.robots.trees import turned

FLAT = np.diag([0.01, 0.02, 0.1])
READERS = [
    pytest.param(from_urdf, changed(GOOD, INERTIA, inertia("0.01", "0.02", "0.1")), "link `fore`", id="URDF"),
    pytest.param(
        from_mjcf,
        changed(bad_mjcf.GOOD, bad_mjcf.INERTIAL, bad_mjcf.inertial(moments="0.01 0.02 0.1 0 0 0")),
        "body `fore`",
        id="MJCF",
    ),
    pytest.param(
        from_mjcf,
        changed(
            bad_mjcf.GOOD,
            bad_mjcf.INERTIAL,
            '<inertial pos="0.1 0.01 0" mass="1.25" diaginertia="0.01 0.02 0.1"/>',
        ),
        "body `fore`",
        id="MJCF, moments",
    ),
]


def second_moments(tensor: np.ndarray) -> np.ndarray:
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor


def of_no_body(rng: np.random.Generator) -> np.ndarray:
    axes = turned(rng)
    while True:
        moments = rng.uniform(-0.2, 1.0, 3)
        if moments.sum() < 1.8 * moments.max():
            return axes @ np.diag(moments) @ axes.T


def by_search(tensor: np.ndarray) -> np.ndarray:
    """The nearest Σ = L Lᵀ, whatever L is: found without eigenvalues."""
    lower = np.tril_indices(3)
    goal = second_moments(tensor)

    def factor(x: np.ndarray) -> np.ndarray:
        root = np.zeros((3, 3))
        root[lower] = x
        return root

    def distance(x: np.ndarray) -> float:
        return float(np.sum((factor(x) @ factor(x).T - goal) ** 2))

    starts = np.random.default_rng(0).normal(size=(4, 6))
    best = min((minimize(distance, x, tol=1e-14) for x in starts), key=lambda found: found.fun)
    sigma = factor(best.x) @ factor(best.x).T
    return np.trace(sigma) * np.eye(3) - sigma


@pytest.mark.parametrize("seed", range(8))
def test_it_is_a_bodys_and_none_that_a_search_finds_is_nearer(seed):
    given = of_no_body(np.random.default_rng(seed))
    assert not is_rigid(given)
    found = nearest_rigid(given)
    assert is_rigid(found)
    np.testing.assert_allclose(found, by_search(given), rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_projection(seed):
    """What is cut off is at right angles to what is left, and to every body points away from it (Moreau)."""
    rng = np.random.default_rng(seed)
    given = of_no_body(rng)
    kept = second_moments(nearest_rigid(given))
    cut = second_moments(given) - kept
    assert np.abs(cut).max() > 1e-3
    assert abs(np.sum(cut * kept)) < 1e-14
    for _ in range(50):
        points = rng.normal(size=(4, 3))
        assert np.sum(cut * (points.T @ points)) <= 1e-14
    np.testing.assert_allclose(nearest_rigid(nearest_rigid(given)), nearest_rigid(given), rtol=0, atol=1e-15)


def test_the_one_of_a_plate_that_is_too_heavy_at_its_rim():
    """By hand: Σ = diag(.055, .045, -.035), so the nearest is diag(.055, .045, 0), a plate."""
    np.testing.assert_allclose(nearest_rigid(FLAT), np.diag([0.045, 0.055, 0.1]), rtol=0, atol=1e-16)


@pytest.mark.parametrize(("read", "text", "owner"), READERS)
def test_a_file_with_such_an_inertia_is_refused_unless_the_nearest_is_asked_for(read, text, owner):
    with pytest.raises(DefinitionError, match=rf'{owner} is of no rigid body.*; inertias="nearest" takes the nearest'):
        read(text)
    with pytest.warns(DefinitionWarning) as caught:
        arm = read(text, inertias="nearest")
    (warning,) = caught
    assert str(warning.message) == (
        f"arm: the nearest inertia that a body can have is taken, as the given one is of none, for {owner} (48 %)"
    )
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.045, 0.055, 0.1], rtol=1e-12)
    np.testing.assert_array_equal(arm.inertias[0], read(GOOD if read is from_urdf else bad_mjcf.GOOD).inertias[0])


def test_another_word_is_refused():
    with pytest.raises(DefinitionError, match="`inertias` must be `given` or `nearest`; got `neerest`; did you mean"):
        Feasible("neerest")


def test_a_link_that_is_fixed_gets_the_nearest_too():
    text = changed(GOOD, TOOL, FLAT_TOOL)
    with pytest.warns(DefinitionWarning, match=r"for link `tool` \(\d+ %\)"):
        arm = from_urdf(text, inertias="nearest")
    as_it_should_be = FLAT_TOOL.replace('ixx="1"', 'ixx="1.5"').replace('iyy="1"', 'iyy="1.5"')
    expected = from_urdf(changed(GOOD, TOOL, as_it_should_be.replace('izz="3"', 'izz="3.0"')))
    np.testing.assert_allclose(arm.inertias, expected.inertias, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("read", "text"), [(from_urdf, bad_urdf.GOOD), (from_mjcf, bad_mjcf.GOOD)])
def test_where_every_inertia_is_a_bodys_nothing_changes(read, text):
    np.testing.assert_array_equal(read(text, inertias="nearest").inertias, read(text).inertias)


def test_what_mujoco_balances_itself_is_left_to_it():
    text = changed(
        bad_mjcf.GOOD,
        bad_mjcf.INERTIAL,
        bad_mjcf.inertial(moments="0.01 0.02 0.1 0 0 0"),
        bad_mjcf.COMPILER,
        '<compiler angle="degree" balanceinertia="true"/>',
    )
    moments = np.linalg.eigvalsh(from_mjcf(text).inertias[1])
    np.testing.assert_allclose(moments, np.full(3, 0.13 / 3), rtol=1e-9)
