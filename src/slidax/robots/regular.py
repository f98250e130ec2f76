"""Check of the inertia matrix: each joint must move some mass that no other joint accounts for."""

from __future__ import annotations

import math

import numpy as np

from slidax._errors import DefinitionError

from .articulated import Articulated

POSTURES = 3

LEAST = 1e-12
"""Of the eigenvalues of M, once its diagonal is scaled to 1; rounding alone leaves some 1e-16."""


def require_regular(arm: Articulated) -> None:
    """Raise DefinitionError, naming a joint that can move without moving mass, if M is singular in all tested postures.

    M is singular, for example, if two joints have one axis and nothing between them has mass.
    """
    least, joint = 0.0, 0
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, arm.joints)):
        mass = _inertia_matrix(arm, q)
        scale = np.sqrt(np.maximum(np.diagonal(mass), 0.0))
        if np.all(scale > 0):
            values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
            least, joint = max(least, float(values[0])), int(np.argmax(np.abs(vectors[:, 0])))
        else:
            joint = int(np.argmin(scale))
    if least < LEAST:
        raise DefinitionError(
            f"the inertia matrix of {arm.name} is singular: joint `{arm.joint_names[joint]}` can move without moving "
            "any mass, by itself or against others; give the links between them mass, or the joint an armature"
        )


def _inertia_matrix(arm: Articulated, q: np.ndarray) -> np.ndarray:
    """`Σ m Jᵥᵀ Jᵥ + J_ωᵀ I J_ω` in NumPy: JAX would compile a program for each operation of a new arm."""
    rotations, translations = np.asarray(arm.rotations), np.asarray(arm.translations)
    centers, inertias, masses = np.asarray(arm.centers), np.asarray(arm.inertias), np.asarray(arm.masses)
    placed: list[tuple[np.ndarray, np.ndarray]] = []
    mass = np.diag(np.asarray(arm.armature))
    for i, parent in enumerate(arm.parents):
        before, at = placed[parent] if parent >= 0 else (np.eye(3), np.zeros(3))
        rotation, place = before @ rotations[i], at + before @ translations[i]
        if arm.joint_units[i] == "rad":
            c, s = math.cos(q[i]), math.sin(q[i])
            rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        else:
            place = place + q[i] * rotation[:, 2]
        placed.append((rotation, place))
        center = place + rotation @ centers[i]
        linear, angular = np.zeros((3, arm.joints)), np.zeros((3, arm.joints))
        j = i
        while j >= 0:
            axis = placed[j][0][:, 2]
            if arm.joint_units[j] == "rad":
                angular[:, j], linear[:, j] = axis, np.cross(axis, center - placed[j][1])
            else:
                linear[:, j] = axis
            j = arm.parents[j]
        turned = rotation @ inertias[i] @ rotation.T
        mass = mass + masses[i] * linear.T @ linear + angular.T @ turned @ angular
    return mass
