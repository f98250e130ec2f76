"""The nearest inertia that a body can have, and the files that need it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import minimize

from slidax.arms import from_mjcf, from_urdf
from slidax.arms.files.inertias import RigidInertias
from slidax.arms.joint import is_rigid, nearest_rigid
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms import bad_mjcf, bad_urdf
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import FLAT_TOOL, GOOD, INERTIA, TOOL, inertia
from tests.arms.trees import turned

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
            bad_mjcf.GOOD, bad_mjcf.INERTIAL, '<inertial pos="0.1 0.01 0" mass="1.25" diaginertia="0.01 0.02 0.1"/>'
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
def test_nearest_inertia_is_rigid_and_no_search_finds_a_nearer_one(seed):
    given = of_no_body(np.random.default_rng(seed))
    assert not is_rigid(given)
    found = nearest_rigid(given)
    assert is_rigid(found)
    np.testing.assert_allclose(found, by_search(given), rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_nearest_inertia_is_the_projection(seed):
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


def test_nearest_inertia_of_a_plate_with_a_heavy_rim():
    """By hand: Σ = diag(.055, .045, -.035), so the nearest is diag(.055, .045, 0), a plate."""
    np.testing.assert_allclose(nearest_rigid(FLAT), np.diag([0.045, 0.055, 0.1]), rtol=0, atol=1e-16)


@pytest.mark.parametrize(("read", "text", "owner"), READERS)
def test_impossible_inertia_is_an_error_unless_nearest_is_set(read, text, owner):
    with pytest.raises(DefinitionError, match=rf'{owner} is of no rigid body.*; inertias="nearest" takes the nearest'):
        read(text)
    with pytest.warns(DefinitionWarning) as caught:
        arm = read(text, inertias="nearest")
    (warning,) = caught
    assert str(warning.message) == (
        "arm: inertias are changed to the nearest that a rigid body can have, by a part of the largest principal "
        f"moment: {owner} (35 %)"
    )
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.045, 0.055, 0.1], rtol=1e-12)
    np.testing.assert_array_equal(arm.inertias[0], read(GOOD if read is from_urdf else bad_mjcf.GOOD).inertias[0])


def test_unknown_choice_of_inertias_is_an_error():
    with pytest.raises(DefinitionError, match="must be `given`, `nearest` or `strict`; got `neerest`; did you mean"):
        RigidInertias("neerest")


def test_fixed_link_gets_the_nearest_inertia_too():
    text = changed(GOOD, TOOL, FLAT_TOOL)
    with pytest.warns(DefinitionWarning, match=r"link `tool` \(17 %\)"):
        arm = from_urdf(text, inertias="nearest")
    as_it_should_be = FLAT_TOOL.replace('ixx="1"', 'ixx="1.5"').replace('iyy="1"', 'iyy="1.5"')
    expected = from_urdf(changed(GOOD, TOOL, as_it_should_be.replace('izz="3"', 'izz="3.0"')))
    np.testing.assert_allclose(arm.inertias, expected.inertias, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("read", "text"), [(from_urdf, bad_urdf.GOOD), (from_mjcf, bad_mjcf.GOOD)])
def test_possible_inertias_stay_unchanged(read, text):
    np.testing.assert_array_equal(read(text, inertias="nearest").inertias, read(text).inertias)


def test_balanceinertia_is_left_to_mujoco():
    text = changed(
        bad_mjcf.GOOD,
        bad_mjcf.INERTIAL,
        bad_mjcf.inertial(moments="0.01 0.02 0.1 0 0 0"),
        bad_mjcf.COMPILER,
        '<compiler angle="degree" balanceinertia="true"/>',
    )
    moments = np.linalg.eigvalsh(from_mjcf(text).inertias[1])
    np.testing.assert_allclose(moments, np.full(3, 0.13 / 3), rtol=1e-9)


def largest_change(printed: np.ndarray) -> float:
    """In parts of the largest principal moment, from the second moments by hand."""
    moments = np.linalg.eigvalsh(printed)
    sigma = 0.5 * moments.sum() - moments
    kept = np.maximum(sigma, 0.0)
    return float(np.abs(kept.sum() - kept - moments).max() / moments[2])


def with_moments(kind: str, moments: str) -> tuple[object, str]:
    """A reader, and the good arm with these moments in its forearm."""
    if kind == "urdf":
        return from_urdf, changed(GOOD, INERTIA, inertia(*moments.split()))
    return from_mjcf, changed(
        bad_mjcf.GOOD, bad_mjcf.INERTIAL, f'<inertial pos="0.1 0.01 0" mass="1.25" diaginertia="{moments}"/>'
    )


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_an_inertia_within_one_percent_is_read_with_one_warning(kind):
    """By hand: Σ = diag(.05, .05, -.00099), so two moments grow by 0.00099, 0.99 % of the largest."""
    read, text = with_moments(kind, "0.04901 0.04901 0.1")
    with pytest.warns(DefinitionWarning) as caught:
        arm = read(text)
    (warning,) = caught
    owner = "link `fore`" if kind == "urdf" else "body `fore`"
    assert f'moment: {owner} (0.99 %); inertias="strict" refuses them' in str(warning.message)
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.05, 0.05, 0.1], rtol=1e-12)


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_an_inertia_beyond_one_percent_is_refused_and_its_remedy_works(kind):
    read, text = with_moments(kind, "0.04899 0.04899 0.1")
    with pytest.raises(DefinitionError, match=r'`fore` is of no rigid body.*; inertias="nearest" takes') as caught:
        read(text)
    with pytest.warns(DefinitionWarning, match=r"`fore` \(1 %\)$"):
        arm = read(text, **{caught.value.setting.name: caught.value.setting.value})
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.05, 0.05, 0.1], rtol=1e-12)


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_strict_refuses_what_is_otherwise_replaced_and_reads_a_plate(kind):
    read, text = with_moments(kind, "0.04901 0.04901 0.1")
    with pytest.raises(DefinitionError, match="`fore` is of no rigid body"):
        read(text, inertias="strict")
    read, text = with_moments(kind, "0.05 0.05 0.1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for choice in ("given", "strict"):
            np.testing.assert_allclose(np.linalg.eigvalsh(read(text, inertias=choice).inertias[1]), [0.05, 0.05, 0.1])


@pytest.mark.parametrize("moments", ["-0.0005 0.1 0.1", "0.1 -0.0005 0.1", "-0.0002 0.1 0.101"])
def test_a_negative_moment_is_refused_however_small_the_change_is(moments):
    with pytest.raises(DefinitionError, match="`fore` must be positive definite"):
        from_urdf(changed(GOOD, INERTIA, inertia(*moments.split())))


def test_link_beyond_the_bound_is_an_error_next_to_one_within_it():
    text = changed(GOOD, INERTIA, inertia("0.04901", "0.04901", "0.1"), TOOL, FLAT_TOOL)
    with pytest.raises(DefinitionError, match="link `tool` is of no rigid body"):
        from_urdf(text)
    with pytest.warns(DefinitionWarning, match=r"moment: link `tool` \(17 %\) and link `fore` \(0.99 %\)$") as caught:
        from_urdf(text, inertias="nearest")
    assert len(caught) == 1


def test_any_body_printed_to_three_digits_is_read():
    """Plates in any axes, where rounding leads out of what bodies can have."""
    rng = np.random.default_rng(11)
    changes = []
    for _ in range(2000):
        sigma = rng.uniform(0.02, 1.0, 3) * np.array([1.0, 1.0, 0.0])
        axes = np.eye(3) if rng.integers(2) else turned(rng)
        true = (axes * (sigma.sum() - sigma)) @ axes.T * 10.0 ** rng.uniform(-6, 1)
        printed = np.array([[float(f"{entry:.2e}") for entry in row] for row in 0.5 * (true + true.T)])
        if not is_rigid(printed):
            changes.append(largest_change(printed))
            rigid = RigidInertias("given").of(printed, "link `fore`", moves=True)
            assert np.linalg.eigvalsh(0.5 * np.trace(rigid) * np.eye(3) - rigid)[0] > -1e-15 * np.trace(rigid)
    assert len(changes) > 500 and 0.002 < max(changes) < 0.0072


def test_moments_that_are_rounded_zeros_are_those_of_a_point():
    dust = changed(GOOD, INERTIA, inertia("0", "0", "0", "1.3e-20"))
    for how in ("given", "nearest"):
        with pytest.raises(
            DefinitionError, match=r"`fore` must be positive definite.*; write the body's own there"
        ) as it:
            from_urdf(dust, inertias=how)
        assert "nearest" not in str(it.value)
    rounded = 'ixx="0" iyy="0" izz="0" ixy="1.3e-20" ixz="0" iyz="0"'
    point = (
        f'{TOOL}<joint name="weld" type="fixed"><parent link="tool"/><child link="dust"/></joint><link name="dust">'
        f'<inertial><mass value="0.1"/><inertia {rounded}/></inertial></link>'
    )
    assert from_urdf(changed(GOOD, TOOL, point), tip="tool").joints == 2
