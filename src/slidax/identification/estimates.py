"""From fitted parameters to an arm, and to numbers with names, units and standard errors."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np

from slidax._errors import as_array
from slidax.robots import Articulated, Payload

from .identification import Estimated
from .least_squares import Fit
from .regressor import BODY, PAIRS, body_of_parameters
from .unknowns import REACH, Unknowns

SEEN = 0.1
"""A number is seen if its standard error is less than this share of what it was believed to be off by."""

UNITS = {
    "armature": ("kg m²", "kg"),
    "coulomb": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "asymmetry": ("N m s/rad", "N s/m"),
    "offset": ("N m", "N"),
}
"""Of what drives have, for a joint that turns and for one that slides."""

PATHS = {"armature": "nominal.armature", "coulomb": "plant.coulomb", "viscous": "plant.viscous"}
"""Where the description of a robot has them."""

OF_BODY = (
    ("mass", "kg", "mass"),
    *((f"center.{axis}", "m", f"center.{i}") for i, axis in enumerate("xyz")),
    *((f"inertia.{pair}", "kg m²", f"inertia.{i}") for i, pair in enumerate(("xx", "yy", "zz", "xy", "xz", "yz"))),
)
"""A body's numbers: name, unit, and where its description has each."""


def identified_robot(robot: Articulated, unknowns: Unknowns, theta: np.ndarray) -> Articulated:
    """The arm with what was identified in place of what was known.

    - `robot`: the arm as it was known.
    - `theta`: its parameters.
    """
    changes: dict[str, Any] = {}
    for name in ("armature", "coulomb", "viscous"):
        values = theta[[i for i, other in enumerate(unknowns.names) if other == name]]
        if len(values):
            changes[name] = as_array(np.maximum(values, 0.0))
    links = []
    for start in unknowns.bodies:
        mass, center, inertia = body_of_parameters(theta[start : start + BODY])
        if unknowns.joints[start] < 0:
            changes["payload"] = Payload(mass=as_array(mass), center=as_array(center), inertia=as_array(inertia))
        else:
            links.append((mass, center, inertia))
    if links:
        masses, centers, inertias = (np.array(values) for values in zip(*links, strict=True))
        changes |= {"masses": as_array(masses), "centers": as_array(centers), "inertias": as_array(inertias)}
    names = list(changes)
    return eqx.tree_at(lambda arm: [getattr(arm, name) for name in names], robot, [changes[name] for name in names])


def estimates_of(robot: Articulated, unknowns: Unknowns, fitted: Fit, theta: np.ndarray) -> tuple[Estimated, ...]:
    """Each number with its standard error, and whether the log shows it.

    - `robot`: the arm as it was known.
    - `fitted`: the fit without conditions, whose standard errors these are.
    - `theta`: the parameters with them.
    """
    listed: list[Estimated] = []
    inside = np.zeros(len(theta), bool)
    for number, start in enumerate(unknowns.bodies):
        own = slice(start, start + BODY)
        inside[own] = True
        listed += _of_body(
            robot, unknowns.joints[start], number, theta[own], fitted.covariance[own, own], unknowns, own
        )
    errors = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    for i in np.nonzero(~inside)[0]:
        name, joint = unknowns.names[i], unknowns.joints[i]
        listed.append(
            Estimated(
                name=name,
                joint=robot.joint_names[joint],
                path=f"{PATHS[name]}.{joint}" if name in PATHS else "",
                unit=UNITS[name][robot.joint_units[joint] == "m"],
                value=float(theta[i]),
                standard_error=float(errors[i]),
                identifiable=bool(errors[i] < SEEN * unknowns.scale[i]),
            )
        )
    return tuple(listed)


def _of_body(
    robot: Articulated,
    joint: int,
    number: int,
    phi: np.ndarray,
    covariance: np.ndarray,
    unknowns: Unknowns,
    own: slice,
) -> list[Estimated]:
    """Mass, centre and inertia about the centre, whose errors follow from those of φ to first order."""
    values = _told(phi)
    sizes = unknowns.scale[own]
    slopes = np.empty((BODY, BODY))
    for i in range(BODY):
        step = 1e-6 * sizes[i]
        slopes[:, i] = (_told(phi + step * np.eye(BODY)[i]) - _told(phi - step * np.eye(BODY)[i])) / (2.0 * step)
    errors = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    mass = max(values[0], 1e-9)
    # The prior scale of centre and inertia follows the identified mass.
    believed = np.array([sizes[0], *3 * (REACH,), *6 * (mass * REACH**2,)])
    what, place = ("payload", "nominal.load") if joint < 0 else ("link", "nominal.links")
    listed = []
    for i, (name, unit, path) in enumerate(OF_BODY):
        kind, _, entry = path.partition(".")
        within = f".{number}" if joint >= 0 else ""
        listed.append(
            Estimated(
                name=f"{what}.{name}",
                joint="" if joint < 0 else robot.joint_names[joint],
                path=f"{place}.{kind}{within}{'.' if entry else ''}{entry}",
                unit=unit,
                value=float(values[i]),
                standard_error=float(errors[i]),
                identifiable=bool(errors[i] < SEEN * believed[i]),
            )
        )
    return listed


def _told(phi: np.ndarray) -> np.ndarray:
    """Mass, centre and inertia about the centre, [10]."""
    mass = phi[0] if abs(phi[0]) > 1e-9 else 1e-9
    _, center, inertia = body_of_parameters(np.array([abs(mass), *np.sign(mass) * phi[1:]]))
    return np.array([mass, *center, *(np.sign(mass) * inertia[pair] for pair in PAIRS)])
