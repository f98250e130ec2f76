"""A tree of links with branches, prismatic joints, skew axes, fixed and locked joints."""

import numpy as np

from slidax.arms import Articulated, Joint, assemble


def turned(rng) -> np.ndarray:
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return axes * np.sign(np.linalg.det(axes))


def random_joint(rng, name, parent, kind="revolute", **more) -> Joint:
    moments = rng.uniform(0.5, 1.0, 3) * 0.05
    axes = turned(rng)
    fields = {
        "name": name,
        "kind": kind,
        "parent": parent,
        "link": f"{name}_link",
        "rotation": turned(rng),
        "translation": rng.normal(size=3) * 0.3,
        "axis": rng.normal(size=3),
        "mass": rng.uniform(0.5, 3.0),
        "center": rng.normal(size=3) * 0.1,
        "inertia": axes @ np.diag(moments) @ axes.T,
    }
    return Joint(**fields | more)


def tree_joints(seed=0) -> list[Joint]:
    rng = np.random.default_rng(seed)
    return [
        random_joint(rng, "waist", None, armature=0.1),
        random_joint(rng, "lift", "waist", "prismatic", armature=0.5),
        random_joint(rng, "left", "lift"),
        random_joint(rng, "mount", "lift", "fixed"),
        random_joint(rng, "right", "mount"),
        random_joint(rng, "wrist", "left"),
        random_joint(rng, "finger", "wrist", "prismatic", lower=-0.2, upper=0.2),
        random_joint(rng, "camera", "finger", "fixed"),
    ]


def small_tree() -> Articulated:
    """A tree with a joint of each kind and a branch; its matrices compile in half the time."""
    rng = np.random.default_rng(1)
    joints = [
        random_joint(rng, "waist", None, armature=0.1),
        random_joint(rng, "lift", "waist", "prismatic", armature=0.5),
        random_joint(rng, "mount", "waist", "fixed"),
        random_joint(rng, "arm", "mount"),
        random_joint(rng, "finger", "arm", "prismatic", lower=-0.2, upper=0.2),
        random_joint(rng, "camera", "finger", "fixed"),
    ]
    return assemble(joints, tip="camera_link", locked={"finger": 0.1}, name="small_tree")


def tree() -> Articulated:
    return assemble(tree_joints(), tip="camera_link", locked={"finger": 0.1}, name="tree")
