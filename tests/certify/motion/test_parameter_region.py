"""Regions of an identified arm: their cover, and their suprema along a motion, against arms of the band."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from slidax.certify.motion.body_points import BodyPoints
from slidax.certify.motion.parameter_region import BodyBand, ParameterRegion, identified_region
from slidax.certify.motion.path import Path
from slidax.certify.motion.path_cells import PathCells, Pieces
from slidax.certify.motion.path_suprema import Suprema, suprema
from slidax.certify.motion.path_tube import Tube
from slidax.certify.motion.region_norms import over_ellipsoid
from slidax.certify.motion.tracking_bound import ArmUncertainty
from slidax.core.errors import DefinitionError
from slidax.identify.regressor import JointMotion

from .cases import Members, identified, knotted, still

NAMES = ("panda", "ur5e")
WIDTH, SPEED = 2e-3, 0.1


@cache
def region_of(name: str) -> ParameterRegion:
    return identified_region(*identified(name))


@pytest.mark.parametrize("name", NAMES)
def test_arms_of_the_identified_ellipsoid_lie_within_its_cover(name: str) -> None:
    region, rng = region_of(name), np.random.default_rng(0)
    covers = region.points.swapaxes(1, 2) @ region.points
    own = BodyPoints.of(identified(name)[0]).pseudo_inertias
    for body, cover in enumerate(covers):
        # Some directions of the first body affect no torque and have no width.
        root = np.linalg.inv(np.linalg.cholesky(cover + 1e-9 * np.trace(own[body]) * np.eye(4)))
        scaled = root @ region.deviations[:, body] @ root.T
        largest = 0.0
        for _ in range(20):
            share = rng.normal(size=len(scaled))
            # The worst direction for a deviation and the worst deviation for a direction, in turn.
            for _ in range(30):
                share /= np.linalg.norm(share)
                values, vectors = np.linalg.eigh(np.tensordot(share, scaled, axes=1))
                worst = vectors[:, np.argmax(np.abs(values))]
                largest = max(largest, float(np.abs(values).max()))
                share = np.einsum("i,rij,j->r", worst, scaled, worst)
        assert 0.3 < largest <= 1.0
    rotors = region.rotor_deviations
    np.testing.assert_allclose(np.linalg.norm(rotors, axis=0), region.rotors)


@pytest.mark.parametrize("name", NAMES)
def test_the_choice_of_unidentifiable_parameters_changes_no_torque(name: str) -> None:
    arm, band = identified(name)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 30, arm.joints))
    bodies, region = BodyPoints.of(arm), region_of(name)
    path = Path.of(bodies, region, still(q, dq, ddq))
    exact = over_ellipsoid(path)
    np.testing.assert_allclose(exact["torque"], band.torque_error(arm, JointMotion(q, dq, ddq)), rtol=1e-6)
    size = np.sqrt(np.sum(region.deviations**2, axis=(0, 2, 3)))
    assert np.all(size < np.linalg.norm(bodies.pseudo_inertias, axis=(1, 2)))


def largest(columns: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """`max ‖M0⁻¹ A ξ‖` over |ξ| <= 1 in the metric, for forces A [N n r]."""
    scaled = np.linalg.inv(np.linalg.cholesky(mass)) @ columns
    return np.linalg.norm(scaled, 2, axis=(1, 2))


def of_matrices(matrices: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Lower bound [N] of the largest norm of `M0⁻¹ Σ ξ_r B_r` over |ξ| <= 1, from random starts."""
    root = np.linalg.inv(np.linalg.cholesky(mass))
    scaled = np.einsum("nki,nijr,nlj->nklr", root, matrices, root)
    rng, best = np.random.default_rng(0), np.zeros(len(mass))
    for _ in range(8):
        share = rng.normal(size=(len(mass), matrices.shape[3]))
        for _ in range(15):
            share /= np.linalg.norm(share, axis=1, keepdims=True)
            left, values, right = np.linalg.svd(np.einsum("nijr,nr->nij", scaled, share))
            best = np.maximum(best, values[:, 0])
            share = np.einsum("ni,nijr,nj->nr", left[:, :, 0], scaled, right[:, 0])
    return best


@pytest.mark.parametrize("name", NAMES)
def test_suprema_at_a_state_agree_with_the_worst_arms_of_the_ellipsoid(name: str) -> None:
    members, rng, step = Members(name), np.random.default_rng(1), 1e-5
    q, dq, ddq, dddq = (rng.normal(size=(12, members.arm.joints)) for _ in range(4))
    exact = over_ellipsoid(Path.of(BodyPoints.of(members.arm), region_of(name), still(q, dq, ddq, dddq)))
    mass = members.nominal(q)
    torque = members.torque(q, dq, ddq)
    np.testing.assert_allclose(exact["force"], largest(torque, mass), rtol=1e-6)
    np.testing.assert_allclose(exact["joints"], np.linalg.norm(np.linalg.solve(mass, torque), axis=2), rtol=1e-6)

    def ahead(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return q + t * dq + t**2 / 2 * ddq, dq + t * ddq + t**2 / 2 * dddq, ddq

    rate = (members.torque(*ahead(step)) - members.torque(*ahead(-step))) / (2 * step)
    np.testing.assert_allclose(exact["rate"], largest(rate, mass), rtol=1e-5)
    units = step * np.eye(q.shape[1])
    by_q, by_dq = (
        np.stack(
            [
                (members.torque(q + a * row, dq + b * row, ddq) - members.torque(q - a * row, dq - b * row, ddq))
                / (2 * step)
                for row in units
            ],
            axis=2,
        )
        for a, b in ((1.0, 0.0), (0.0, 1.0))
    )
    stiffness = np.stack([largest(by_q[:, :, j], mass) for j in range(q.shape[1])], axis=1)
    np.testing.assert_allclose(exact["stiffness"], stiffness, rtol=1e-5, atol=1e-9)
    by_joint = [(members.inertia(q + row) - members.inertia(q - row)) / (2 * step) for row in units]
    slopes = np.stack([of_matrices(matrices, mass) for matrices in by_joint], axis=1)
    assert np.all(slopes <= exact["slopes"] * (1 + 1e-6) + 1e-9)
    assert np.all(exact["slopes"] <= 2.5 * slopes + 1e-9)
    error = members.inertia(q)
    np.testing.assert_allclose(exact["error"], np.linalg.norm(error, axis=3), rtol=1e-6, atol=1e-9)
    relative = np.linalg.solve(mass[:, None], np.moveaxis(error, 3, 1))
    np.testing.assert_allclose(exact["relative"], np.linalg.norm(relative, axis=1), rtol=1e-6, atol=1e-9)
    growth = (members.inertia(q + step * dq) - members.inertia(q - step * dq)) / (2 * step)
    for key, matrices in (("coriolis", by_dq), ("growth", growth)):
        norms = of_matrices(matrices, mass)
        assert np.all(norms <= exact[key] * (1 + 1e-6))
        assert np.all(exact[key] <= 2.5 * norms)


@cache
def case(name: str) -> tuple[Members, Any, PathCells, Path, Tube, Suprema]:
    members = Members(name)
    motion = knotted(members.arm, np.random.default_rng(4), 0.8)
    cells = PathCells.of(motion, 1e-3)
    path = Path.of(BodyPoints.of(members.arm), region_of(name), cells)
    wide = np.ones_like(cells.speed)
    norm = SPEED * np.sqrt(np.einsum("ni,nij,nj->n", wide, np.abs(path.mass), wide)) * 1.05
    tube = Tube(WIDTH * wide, SPEED * wide, norm, SPEED * wide, norm, 5.0 * wide, 50.0 * norm, 5.0 * wide, 50.0 * norm)
    bounds = suprema(path, tube)
    assert bounds is not None
    return members, motion, cells, path, tube, bounds


State = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def band(members: Members, at: State, there: State) -> np.ndarray:
    return largest(members.torque(*at[:3]), members.nominal(at[0]))


def band_joints(members: Members, at: State, there: State) -> np.ndarray:
    return np.linalg.norm(np.linalg.solve(members.nominal(at[0]), members.torque(*at[:3])), axis=2)


def band_torque(members: Members, at: State, there: State) -> np.ndarray:
    return np.linalg.norm(members.torque(*at[:3]), axis=2)


def band_rate(members: Members, at: State, there: State) -> np.ndarray:
    q, dq, ddq, dddq = at
    step = 1e-5
    values = [
        np.linalg.solve(
            members.nominal(q + t * dq), members.torque(q + t * dq + t**2 / 2 * ddq, dq + t * ddq, ddq + t * dddq)
        )
        for t in (-step, step)
    ]
    scaled = np.linalg.cholesky(members.nominal(q)).swapaxes(1, 2) @ (values[1] - values[0]) / (2 * step)
    # The share of the jerk is bounded by p, which an arm of the ellipsoid may pass.
    worst = members.admitted(np.linalg.svd(scaled)[2][:, 0])
    return np.linalg.norm(np.einsum("nir,nr->ni", scaled, worst), axis=1)


def torque_rate(members: Members, at: State, there: State) -> np.ndarray:
    q, dq, ddq, dddq = at
    step = 1e-5
    ahead, behind = (members.torque(q + t * dq + t**2 / 2 * ddq, dq + t * ddq, ddq + t * dddq) for t in (step, -step))
    rate = (ahead - behind) / (2 * step)
    shares = rate / np.maximum(np.linalg.norm(rate, axis=2, keepdims=True), 1e-12)
    admitted = members.admitted(shares.reshape(-1, rate.shape[2])).reshape(rate.shape)
    return np.einsum("nir,nir->ni", rate, admitted)


def band_tube(members: Members, at: State, there: State) -> np.ndarray:
    mass, moved = members.nominal(at[0]), members.nominal(there[0])
    planned = np.linalg.solve(mass, members.torque(*at[:3]))
    return largest(members.torque(there[0], there[1], at[2]) - moved @ planned, moved)


def band_error(members: Members, at: State, there: State) -> np.ndarray:
    return np.linalg.norm(members.inertia(there[0]), axis=3)


def band_torques(members: Members, at: State, there: State) -> np.ndarray:
    root = np.linalg.inv(np.linalg.cholesky(members.nominal(there[0]))).swapaxes(1, 2)
    rows = root.swapaxes(1, 2)[:, None] @ members.inertia(there[0])
    return np.asarray(np.linalg.norm(rows, 2, axis=(2, 3)))


def band_relative(members: Members, at: State, there: State) -> np.ndarray:
    error = np.moveaxis(members.inertia(there[0]), 3, 1)
    return np.linalg.norm(np.linalg.solve(members.nominal(there[0])[:, None], error), axis=1)


def slide(members: Members, at: State, there: State) -> np.ndarray:
    q, dq = there[:2]
    step = 1e-5
    values = [
        np.linalg.solve(members.nominal(q + t * dq)[:, None], np.moveaxis(members.inertia(q + t * dq), 3, 1))
        for t in (-step, step)
    ]
    mass = members.nominal(q)
    rate = mass[:, None] @ (values[1] - values[0]) / (2 * step)
    return of_matrices(np.moveaxis(rate, 1, 3), mass)


QUANTITIES: dict[str, tuple[Callable[[Members, State, State], np.ndarray], float]] = {
    "band": (band, 0.4),
    "band_joints": (band_joints, 0.4),
    "band_torque": (band_torque, 0.4),
    "band_rate": (band_rate, 0.1),
    "torque_rate": (torque_rate, 0.1),
    "band_tube": (band_tube, 0.05),
    "band_error": (band_error, 0.4),
    "band_torques": (band_torques, 0.4),
    "band_relative": (band_relative, 0.4),
    "slide": (slide, 0.05),
}


def climb(name: str, which: str, starts: int, steps: int) -> float:
    """Largest ratio of a quantity to its stored bound, at ends of cells and at corners of the tube."""
    members, motion, cells, _, _, bounds = case(which)
    rng, quantity = np.random.default_rng(1), QUANTITIES[name][0]
    bound = getattr(bounds, name).reshape(len(cells.q), -1)
    # At rest the quantities differ by rounding only.
    bound = np.maximum(bound, 1e-6 * bound.max()) * (1 + 1e-9)
    cell = rng.integers(len(bound), size=starts)
    cell[: starts // 2] = np.argsort(bound.max(axis=1))[-1 - np.arange(starts // 2) % 8]
    t = cells.centres[cell] + rng.choice([-1.0, 0.0, 1.0], size=starts) * cells.half * (1 - 1e-9)
    q, dq, ddq, dddq = Pieces.of(motion).at(t)
    n = q.shape[1]
    corner = rng.choice([-1.0, 1.0], size=(starts, 2 * n))

    def ratios(corner: np.ndarray, repeat: int) -> np.ndarray:
        at = tuple(np.repeat(part, repeat, axis=0) for part in (q, dq, ddq, dddq))
        there = (at[0] + WIDTH * corner[:, :n], at[1] + SPEED * corner[:, n:], at[2], at[3])
        value = quantity(members, at, there)  # type: ignore[arg-type]
        return (value.reshape(len(corner), -1) / np.repeat(bound[cell], repeat, axis=0)).max(axis=1)

    worst = 0.0
    for _ in range(steps):
        here = ratios(corner, 1)
        worst = max(worst, float(here.max()))
        moved = np.repeat(corner, 2 * n, axis=0)
        moved[np.arange(len(moved)), np.tile(np.arange(2 * n), starts)] *= 1.0 - 1e-3
        slope = (here[:, None] - ratios(moved, 2 * n).reshape(starts, 2 * n)) * corner
        corner = np.where(slope >= 0.0, 1.0, -1.0)
    return max(worst, float(ratios(corner, 1).max()))


@pytest.mark.parametrize("name", QUANTITIES)
def test_no_arm_of_the_band_exceeds_the_bounds_along_the_motion(name: str) -> None:
    steps = 1 if name in ("band_tube", "band_error", "band_torques", "band_relative", "slide") else 0
    assert QUANTITIES[name][1] < climb(name, "panda", 16, steps) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("which", NAMES)
@pytest.mark.parametrize("name", QUANTITIES)
def test_no_arm_of_the_band_exceeds_the_bounds_along_the_motion_in_a_long_search(name: str, which: str) -> None:
    assert climb(name, which, 64, 4) <= 1.0


def test_identified_ellipsoid_gives_smaller_bounds_than_a_band_of_the_same_width() -> None:
    members, _, _, path, tube, bounds = case("panda")
    bodies = BodyPoints.of(members.arm)
    per_body = suprema(Path.of(bodies, BodyBand(0.03, 0.03).region(bodies), path.cells), tube)
    assert per_body is not None
    for name in ("band", "band_joints", "band_torque"):
        assert np.median(getattr(bounds, name) / getattr(per_body, name)) < 0.5


def test_friction_uncertainty_covers_the_identified_intervals() -> None:
    arm, band = identified("panda")
    uncertainty = ArmUncertainty.identified(arm, band, resolution=1e-5)
    np.testing.assert_allclose(uncertainty.coulomb, band.coulomb[1])
    largest = np.asarray(arm.viscous) + uncertainty.viscous_error
    assert np.all(largest >= band.viscous[1] - 1e-12)
    assert np.all(np.asarray(arm.viscous) - uncertainty.viscous_error <= band.viscous[0] + 1e-12)
    without = replace(band, coulomb=np.zeros((2, 0)), viscous=np.zeros((2, 0)))
    assert ArmUncertainty.identified(arm, without, coulomb=0.4).coulomb == 0.4
    assert uncertainty.region(BodyPoints.of(arm)).p == band.p


def test_bands_of_the_wrong_shape_or_size_are_refused() -> None:
    arm, band = identified("panda")
    with pytest.raises(DefinitionError, match="77 columns for 7 joints; got 66"):
        identified_region(arm, replace(band, deviations=band.deviations[:, :66]))
    with pytest.raises(DefinitionError, match="below 1"):
        identified_region(arm, replace(band, p=1.2))
