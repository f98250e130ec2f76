"""The nearest inertia of a rigid body, and files with impossible inertias."""

from __future__ import annotations

import numpy as np
import pytest

from slidax.arms import from_mjcf, from_urdf
from slidax.arms.files.inertias import RigidInertias
from slidax.arms.joint import is_rigid, nearest_rigid
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms import bad_mjcf
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import FLAT_TOOL, GOOD, INERTIA, TOOL, inertia
from tests.arms.trees import turned

FLAT = np.diag([0.01, 0.02, 0.1])


def urdf_with(moments: str) -> str:
    """The valid arm with these moments of inertia in its forearm."""
    return changed(GOOD, INERTIA, inertia(*moments.split()))


def mjcf_with(moments: str) -> str:
    full = bad_mjcf.inertial(moments=f"{moments} 0 0 0")
    return changed(bad_mjcf.GOOD, bad_mjcf.INERTIAL, full)


def mjcf_with_diagonal(moments: str) -> str:
    diagonal = f'<inertial pos="0.1 0.01 0" mass="1.25" diaginertia="{moments}"/>'
    return changed(bad_mjcf.GOOD, bad_mjcf.INERTIAL, diagonal)


each_reader = pytest.mark.parametrize(
    ("read", "text_with", "owner"),
    [
        (from_urdf, urdf_with, "link `fore`"),
        (from_mjcf, mjcf_with, "body `fore`"),
        (from_mjcf, mjcf_with_diagonal, "body `fore`"),
    ],
)


def second_moments(tensor: np.ndarray) -> np.ndarray:
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor


def of_no_body(rng: np.random.Generator) -> np.ndarray:
    axes = turned(rng)
    while True:
        moments = rng.uniform(-0.2, 1.0, 3)
        if moments.sum() < 1.8 * moments.max():
            return axes @ np.diag(moments) @ axes.T


@pytest.mark.parametrize("seed", range(8))
def test_nearest_inertia_is_the_projection_onto_rigid_body_inertias(seed):
    """The removed part is orthogonal to the remaining one, and its product with every body is not positive (Moreau)."""
    rng = np.random.default_rng(seed)
    impossible = of_no_body(rng)
    nearest = nearest_rigid(impossible)
    assert is_rigid(nearest) and not is_rigid(impossible)
    kept = second_moments(nearest)
    cut = second_moments(impossible) - kept
    assert np.abs(cut).max() > 1e-3
    assert abs(np.sum(cut * kept)) < 1e-14
    for _ in range(50):
        points = rng.normal(size=(4, 3))
        assert np.sum(cut * (points.T @ points)) <= 1e-14
    np.testing.assert_allclose(nearest_rigid(nearest), nearest, rtol=0, atol=1e-15)


def test_nearest_inertia_of_an_impossible_body_is_that_of_a_plate():
    """By hand: Σ = diag(.055, .045, -.035), so the nearest is diag(.055, .045, 0), a plate."""
    np.testing.assert_allclose(nearest_rigid(FLAT), np.diag([0.045, 0.055, 0.1]), rtol=0, atol=1e-16)


@each_reader
def test_impossible_inertia_is_an_error_unless_nearest_is_set(read, text_with, owner):
    text = text_with("0.01 0.02 0.1")
    with pytest.raises(DefinitionError, match=rf'{owner} is of no rigid body.*; inertias="nearest" takes the nearest'):
        read(text)
    with pytest.warns(DefinitionWarning) as caught:
        arm = read(text, inertias="nearest")
    assert [str(warning.message) for warning in caught] == [
        "arm: inertias that no rigid body can have are changed to the nearest possible; they differ by a share of "
        f"the largest principal moment: {owner} (35 %)"
    ]
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.045, 0.055, 0.1], rtol=1e-12)
    good = read(GOOD if read is from_urdf else bad_mjcf.GOOD)
    np.testing.assert_array_equal(arm.inertias[0], good.inertias[0])
    np.testing.assert_array_equal(
        read(GOOD if read is from_urdf else bad_mjcf.GOOD, inertias="nearest").inertias, good.inertias
    )


def test_unknown_inertias_option_is_refused_with_the_allowed_values():
    with pytest.raises(DefinitionError, match="must be `given`, `nearest` or `strict`; got `neerest`; did you mean"):
        RigidInertias("neerest")


def test_link_behind_a_fixed_joint_gets_the_nearest_inertia():
    text = changed(GOOD, TOOL, FLAT_TOOL)
    with pytest.warns(DefinitionWarning, match=r"link `tool` \(17 %\)"):
        arm = from_urdf(text, inertias="nearest")
    possible = FLAT_TOOL.replace('ixx="1"', 'ixx="1.5"').replace('iyy="1"', 'iyy="1.5"')
    expected = from_urdf(changed(GOOD, TOOL, possible))
    np.testing.assert_allclose(arm.inertias, expected.inertias, rtol=1e-12, atol=1e-14)


def test_balanceinertia_is_applied_by_mujoco():
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
    """Largest change as a fraction of the largest principal moment, from the second moments."""
    moments = np.linalg.eigvalsh(printed)
    sigma = 0.5 * moments.sum() - moments
    kept = np.maximum(sigma, 0.0)
    return float(np.abs(kept.sum() - kept - moments).max() / moments[2])


@each_reader
def test_inertia_correctable_within_one_percent_is_read_with_one_warning(read, text_with, owner):
    """By hand: Σ = diag(.05, .05, -.00099), so two moments grow by 0.00099, 0.99 % of the largest."""
    with pytest.warns(DefinitionWarning) as caught:
        arm = read(text_with("0.04901 0.04901 0.1"))
    (warning,) = caught
    assert f'moment: {owner} (0.99 %); inertias="strict" refuses them' in str(warning.message)
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.05, 0.05, 0.1], rtol=1e-12)


@each_reader
def test_inertia_correctable_only_beyond_one_percent_is_refused_and_its_remedy_works(read, text_with, owner):
    text = text_with("0.04899 0.04899 0.1")
    with pytest.raises(DefinitionError, match=r'`fore` is of no rigid body.*; inertias="nearest" takes') as caught:
        read(text)
    setting = caught.value.setting
    with pytest.warns(DefinitionWarning, match=r"`fore` \(1 %\)$"):
        arm = read(text, **{setting.name: setting.value})
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.05, 0.05, 0.1], rtol=1e-12)
    reworded = str(caught.value.reworded(setting.as_option))
    assert "--inertias nearest takes the nearest" in reworded and "inertias=" not in reworded


@each_reader
def test_strict_option_refuses_a_slightly_impossible_inertia_and_accepts_a_plate(read, text_with, owner):
    with pytest.raises(DefinitionError, match="`fore` is of no rigid body"):
        read(text_with("0.04901 0.04901 0.1"), inertias="strict")
    for choice in ("given", "strict"):
        plate = read(text_with("0.05 0.05 0.1"), inertias=choice)
        np.testing.assert_allclose(np.linalg.eigvalsh(plate.inertias[1]), [0.05, 0.05, 0.1])


@pytest.mark.parametrize("moments", ["-0.0005 0.1 0.1", "0.1 -0.0005 0.1", "-0.0002 0.1 0.101"])
def test_a_negative_moment_is_refused_even_if_the_correction_is_small(moments):
    with pytest.raises(DefinitionError, match="`fore` must be positive definite"):
        from_urdf(changed(GOOD, INERTIA, inertia(*moments.split())))


def test_one_link_with_an_impossible_inertia_refuses_the_whole_file():
    text = changed(GOOD, INERTIA, inertia("0.04901", "0.04901", "0.1"), TOOL, FLAT_TOOL)
    with pytest.raises(DefinitionError, match="link `tool` is of no rigid body"):
        from_urdf(text)
    with pytest.warns(DefinitionWarning, match=r"moment: link `tool` \(17 %\) and link `fore` \(0.99 %\)$") as caught:
        from_urdf(text, inertias="nearest")
    assert len(caught) == 1


def test_every_inertia_rounded_to_three_digits_is_accepted():
    """Plates about any axes: rounding can make their inertia impossible."""
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


def test_inertia_of_rounding_errors_counts_as_zero():
    dust = changed(GOOD, INERTIA, inertia("0", "0", "0", "1.3e-20"))
    for how in ("given", "nearest"):
        with pytest.raises(
            DefinitionError, match=r"`fore` must be positive definite.*; give the body its true inertia"
        ) as caught:
            from_urdf(dust, inertias=how)
        assert "nearest" not in str(caught.value)
    rounded = 'ixx="0" iyy="0" izz="0" ixy="1.3e-20" ixz="0" iyz="0"'
    point = (
        f'{TOOL}<joint name="weld" type="fixed"><parent link="tool"/><child link="dust"/></joint><link name="dust">'
        f'<inertial><mass value="0.1"/><inertia {rounded}/></inertial></link>'
    )
    assert from_urdf(changed(GOOD, TOOL, point), tip="tool").joints == 2
