"""Small robot files: an arm of four joints, with what real files have beside it."""

from __future__ import annotations

JOINT = """
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{link}"/><origin xyz="{xyz}"/>
<axis xyz="{axis}"/>{limit}{more}</joint>
<link name="{link}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(
    name: str,
    parent: str,
    link: str,
    *,
    kind: str = "revolute",
    axis: str = "0 1 0",
    limit: tuple[float, float, float, float] | None = (-2.5, 2.5, 2.0, 40.0),
    mass: float = 1.0,
    more: str = "",
    xyz: str = "0 0 0.25",
) -> str:
    said = "" if limit is None else '<limit lower="{}" upper="{}" velocity="{}" effort="{}"/>'.format(*limit)
    return JOINT.format(
        name=name, kind=kind, parent=parent, link=link, axis=axis, limit=said, mass=mass, more=more, xyz=xyz
    )


EFFORTS = (20.0, 40.0, 15.0, 5.0)


def arm(efforts: tuple[float, ...] = EFFORTS, velocity: float = 2.0, more: str = "", **last: object) -> str:
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
    names = ["base", "shoulder", "upper", "fore", "wrist"]
    parts = [
        joint(f"j{i + 1}", names[i], names[i + 1], axis=axes[i], limit=(-2.5, 2.5, velocity + 0.1 * i, efforts[i]))
        for i in range(4)
    ]
    return f'<robot name="four"><link name="base"/>{"".join(parts)}{more}</robot>'


HAND = (
    joint("finger_left", "wrist", "left", kind="prismatic", limit=(0.0, 0.04, 0.1, 10.0), mass=0.05)
    + joint(
        "finger_right",
        "wrist",
        "right",
        kind="prismatic",
        limit=(0.0, 0.04, 0.1, 10.0),
        mass=0.05,
        more='<mimic joint="finger_left"/>',
    )
    + '<joint name="f" type="fixed"><parent link="wrist"/><child link="tool0"/></joint><link name="tool0"/>'
)
