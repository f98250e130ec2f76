"""Joints that cannot be, and lists of joints that are no arm."""

from __future__ import annotations

import numpy as np

from slidax.arms import Joint

NAN, INF = float("nan"), float("inf")


def a_joint(**more) -> Joint:
    """One that can be."""
    given = {
        "name": "elbow",
        "kind": "revolute",
        "parent": None,
        "link": "forearm",
        "mass": 2.0,
        "inertia": np.diag([0.03, 0.04, 0.05]),
    }
    return Joint(**given | more)


def sheared(off: float) -> np.ndarray:
    """An inertia with one product of inertia that has no partner."""
    inertia = np.diag([0.03, 0.04, 0.05])
    inertia[0, 1] = off
    return inertia


BAD_JOINTS = {
    "negative mass": ({"mass": -1.0}, "the mass of link `forearm` must be >= 0 kg and finite; got -1"),
    "mass that is no number": ({"mass": NAN}, "the mass of link `forearm` must be >= 0 kg and finite"),
    "infinite mass": ({"mass": INF}, "the mass of link `forearm` must be >= 0 kg and finite"),
    "centre of mass": (
        {"center": np.array([0.0, NAN, 0.0])},
        "the centre of mass of link `forearm` must be three finite numbers",
    ),
    "centre of two numbers": (
        {"center": np.zeros(2)},
        r"the centre of mass of link `forearm` must be three finite numbers; got \[0.0, 0.0\]",
    ),
    "inertia of one number": ({"inertia": np.ones(3)}, "the inertia of link `forearm` must be 3 x 3 and finite"),
    "inertia that is no number": (
        {"inertia": np.full((3, 3), NAN)},
        "the inertia of link `forearm` must be 3 x 3 and finite",
    ),
    "inertia without mass": ({"mass": 0.0}, "link `forearm` has inertia but no mass; give it a mass > 0 kg"),
    "skew inertia": ({"inertia": sheared(0.01)}, "the inertia of link `forearm` must be symmetric"),
    "inertia of nothing": (
        {"inertia": np.zeros((3, 3))},
        "the inertia of link `forearm` must be positive definite; its principal moments are 0, 0, 0 kg m²",
    ),
    "negative inertia": (
        {"inertia": np.diag([-0.01, 0.02, 0.02])},
        "the inertia of link `forearm` must be positive definite; its principal moments are -0.01, 0.02, 0.02 kg m²",
    ),
    "negative inertia of a fixed link": (
        {"kind": "fixed", "inertia": np.diag([-0.01, 0.02, 0.02])},
        "the inertia of link `forearm` must be positive semi-definite",
    ),
    "inertia beyond the triangle": (
        {"inertia": np.diag([0.01, 0.02, 0.031])},
        "the inertia of link `forearm` is of no rigid body: the largest of its principal moments 0.01, 0.02, 0.031",
    ),
    "frame": ({"rotation": 2.0 * np.eye(3)}, "the frame of joint `elbow` must have orthonormal axes"),
    "frame that is no number": ({"rotation": np.full((3, 3), NAN)}, "the frame of joint `elbow` must have orthonormal"),
    "left-handed frame": (
        {"rotation": np.diag([1.0, 1.0, -1.0])},
        "the frame of joint `elbow` must have orthonormal axes, right-handed",
    ),
    "place": ({"translation": np.array([INF, 0.0, 0.0])}, "the place of joint `elbow` must be three finite numbers"),
    "no axis": ({"axis": np.zeros(3)}, r"the axis of joint `elbow` must have a direction; got \[0.0, 0.0, 0.0\]"),
    "axis that is no number": ({"axis": np.array([0.0, NAN, 1.0])}, "the axis of joint `elbow` must have a direction"),
    "axis of two numbers": ({"axis": np.ones(2)}, r"the axis of joint `elbow` must have a direction; got \[1.0, 1.0\]"),
    "limits": ({"lower": 1.0, "upper": -1.0}, "the limits of joint `elbow` must be lower < upper; got 1 and -1"),
    "limits that are no numbers": ({"lower": NAN}, "the limits of joint `elbow` must be lower < upper"),
    "velocity": ({"velocity": 0.0}, "the velocity limit of joint `elbow` must be > 0; got 0"),
    "torque": ({"torque": -5.0}, "the torque limit of joint `elbow` must be > 0; got -5"),
    "torque rate": ({"torque_rate": NAN}, "the torque rate limit of joint `elbow` must be > 0"),
    "armature": ({"armature": -0.1}, "the armature of joint `elbow` must be >= 0 and finite; got -0.1"),
    "viscous friction": ({"viscous": INF}, "the viscous friction of joint `elbow` must be >= 0 and finite; got inf"),
    "Coulomb friction": ({"coulomb": -1.0}, "the Coulomb friction of joint `elbow` must be >= 0 and finite; got -1"),
}
"""What is changed of a joint that can be, and what is said to it."""

SHOULDER = a_joint(name="shoulder", link="upper arm")
ELBOW = a_joint(parent="shoulder", translation=np.array([0.4, 0.0, 0.0]))
FLANGE = Joint("flange", "fixed", "elbow", "tool")
TIP = {"tip": "tool"}


def still(**more) -> Joint:
    """A joint whose link has no mass."""
    return a_joint(**{"mass": 0.0, "inertia": np.zeros((3, 3))} | more)


BAD_ARMS = {
    "no joints": ([], TIP, "arm has no joint that moves"),
    "nothing moves": ([Joint("flange", "fixed", None, "tool")], TIP, "arm has no joint that moves"),
    "two joints of one name": ([SHOULDER, a_joint(name="shoulder")], TIP, "there are two joints named `shoulder`"),
    "two joints of one link": (
        [SHOULDER, a_joint(link="upper arm")],
        TIP,
        "link `upper arm` is moved by two joints, `shoulder` and `elbow`",
    ),
    "unknown parent": (
        [SHOULDER, a_joint(parent="sholder"), FLANGE],
        TIP,
        "joint `elbow` has the parent joint `sholder`, which does not exist; did you mean `shoulder`?",
    ),
    "parent unlike any other": (
        [SHOULDER, a_joint(parent="x")],
        TIP,
        "joint `elbow` has the parent joint `x`, which does not exist; there are: `shoulder`, `elbow`",
    ),
    "circle": (
        [SHOULDER, a_joint(name="left", link="left link", parent="right"), a_joint(name="right", parent="left")],
        TIP,
        "the joints `left`, `right` carry each other in a circle; an arm is a tree",
    ),
    "unknown tip": (
        [SHOULDER, ELBOW, FLANGE],
        {"tip": "tol"},
        "`tip` names link `tol`, which arm does not have; did you mean `tool`?",
    ),
    "tip that stands still": (
        [Joint("stand", "fixed", None, "table"), SHOULDER],
        {"tip": "table"},
        "`tip` names link `table` of arm, which no joint moves",
    ),
    "unknown locked joint": (
        [SHOULDER, ELBOW, FLANGE],
        TIP | {"locked": {"elbo": 0.0}},
        "`locked` names joint `elbo`, which does not move; did you mean `elbow`?",
    ),
    "locked joint that is fixed": (
        [SHOULDER, ELBOW, FLANGE],
        TIP | {"locked": {"flange": 0.0}},
        "`locked` names joint `flange`, which does not move; there are: `shoulder`, `elbow`",
    ),
    "locked beyond its limits": (
        [SHOULDER, a_joint(parent="shoulder", lower=-1.0, upper=2.0), FLANGE],
        TIP | {"locked": {"elbow": 2.1}},
        "`locked` holds joint `elbow` at 2.1, which is outside of its limits, -1 to 2",
    ),
    "locked nowhere": (
        [SHOULDER, ELBOW, FLANGE],
        TIP | {"locked": {"elbow": NAN}},
        "`locked` holds joint `elbow` at nan, which is outside of its limits",
    ),
    "gravity of two numbers": (
        [SHOULDER, ELBOW, FLANGE],
        TIP | {"gravity": (0.0, -9.81)},
        r"`Articulated.gravity_vector` must be 3 numbers; got shape \[2\]",
    ),
    "nothing heavy at the end": (
        [SHOULDER, still(parent="shoulder"), FLANGE],
        TIP,
        "link `forearm` of arm, moved by joint `elbow`, has no mass, nor has anything that is fixed to it: "
        "give it mass and inertia, or lock the joint",
    ),
    "nothing heavy at all": (
        [still(name="shoulder", link="upper arm"), still(parent="shoulder"), FLANGE],
        TIP,
        "no link that a joint of arm moves has a mass, as in files that are for drawing alone",
    ),
    "a point alone": (
        [SHOULDER, still(parent="shoulder"), Joint("flange", "fixed", "elbow", "tool", mass=1.0)],
        TIP,
        "the inertia of link `forearm`, with all that is fixed to it, must be positive definite",
    ),
    "two joints that move the same": (
        [still(name="shoulder", link="upper arm"), a_joint(parent="shoulder")],
        {"tip": "forearm"},
        "the inertia matrix of arm is singular: joint `(shoulder|elbow)` can move without moving any mass",
    ),
}
"""Joints, how they are assembled, and what is said to it."""
