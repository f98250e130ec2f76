"""Rigid bodies as point masses, which can be rotated, moved and joined without a theorem."""

from __future__ import annotations

import numpy as np

Points = tuple[np.ndarray, np.ndarray]
"""Masses [k] and places [k 3]."""


def points_of(mass: float, center: np.ndarray, inertia: np.ndarray) -> Points:
    """Six points with the same mass, centre of mass and inertia."""
    if mass == 0:
        return np.zeros(0), np.zeros((0, 3))
    moments, axes = np.linalg.eigh(inertia)
    second = np.maximum(moments.sum() / 2.0 - moments, 0.0)
    arms = axes * np.sqrt(3.0 * second / mass)
    return np.full(6, mass / 6.0), center + np.concatenate([arms.T, -arms.T])


def seen_from(rotation: np.ndarray, translation: np.ndarray, points: Points) -> Points:
    """The same points in another frame."""
    return points[0], points[1] @ rotation.T + translation


def body_of(*bodies: Points) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass, and inertia about it."""
    masses, places = (np.concatenate(part) for part in zip(*bodies, strict=True))
    center = masses @ places / masses.sum()
    arms = places - center
    inertia = np.einsum("k,kij->ij", masses, (arms**2).sum(1)[:, None, None] * np.eye(3) - _products(arms))
    return float(masses.sum()), center, inertia


def _products(arms: np.ndarray) -> np.ndarray:
    return arms[:, :, None] * arms[:, None, :]
