"""Random MJCF files with all that moves in them: branches, several joints in a body, offsets, references, gears."""

from __future__ import annotations

import numpy as np


def random_mjcf(seed: int, joints: int) -> str:
    """A tree whose tip is the site `tip`, and whose joint `locked` is to be held."""
    return _Writer(np.random.default_rng(seed), joints).text()


class _Writer:
    def __init__(self, rng: np.random.Generator, joints: int) -> None:
        self.rng, self.wanted = rng, joints
        self.joints: list[str] = []

    def text(self) -> str:
        bodies = self.body(depth=0, tip=True)
        gears = "".join(
            f'<motor joint="{name}" gear="{self.numbers(1, 3.0)}" armature="0.01" damping="0.1"/>'
            for name in self.joints[::2]
        )
        return f"""<mujoco model="tree">
  <compiler angle="{self.rng.choice(["degree", "radian"])}" eulerseq="{self.rng.choice(["xyz", "ZYX", "zxz"])}"/>
  <option gravity="{self.numbers(3, 8.0)}"/>
  <default>
    <joint damping="0.3"/>
    <default class="geared"><joint armature="0.2" frictionloss="0.1"/></default>
  </default>
  <worldbody>{bodies}</worldbody>
  <actuator>{gears}</actuator>
</mujoco>"""

    def body(self, depth: int, tip: bool) -> str:
        rng = self.rng
        joints = "".join(self.joint() for _ in range(rng.integers(1, 3))) if depth != 1 or rng.random() < 0.7 else ""
        if depth == 0:
            joints += self.joint("locked")
        inside = joints + self.weight()
        more = depth < 3 and len(self.joints) < self.wanted
        if more:
            turned = f'<frame pos="{self.numbers(3, 0.2)}" euler="{self.numbers(3, 1.0)}">{{}}</frame>'
            inside += turned.format(self.body(depth + 1, tip))
        elif tip:
            inside += f'<site name="tip" pos="{self.numbers(3, 0.2)}" euler="{self.numbers(3, 1.0)}"/>'
        if more and rng.random() < 0.5:
            inside += self.body(depth + 2, False)
        return f'<body pos="{self.numbers(3, 0.4)}" quat="{self.numbers(4, 1.0)}">{inside}</body>'

    def joint(self, name: str | None = None) -> str:
        name = name or f"j{len(self.joints)}"
        if name != "locked":
            self.joints.append(name)
        kind = self.rng.choice(["hinge", "hinge", "slide"])
        kind = f'type="{kind}" class="{self.rng.choice(["main", "geared"])}"'
        place = f'axis="{self.numbers(3, 1.0)}" pos="{self.numbers(3, 0.1)}" ref="{self.numbers(1, 0.5)}"'
        return f'<joint name="{name}" {kind} {place}/>'

    def weight(self) -> str:
        way = self.rng.integers(3)
        if way == 0:
            size = self.rng.uniform(0.05, 0.2, 3)
            return (
                f'<geom type="box" size="{_words(size)}" pos="{self.numbers(3, 0.1)}" euler="{self.numbers(3, 1.0)}"/>'
            )
        mass = self.rng.uniform(0.5, 3.0)
        root = self.rng.normal(size=(3, 3)) * 0.1
        spread = root @ root.T + 1e-3 * np.eye(3)
        # Of spread masses the inertia always is one of a rigid body.
        inertia = np.trace(spread) * np.eye(3) - spread
        place = f'<inertial pos="{self.numbers(3, 0.1)}" mass="{mass}" '
        if way == 1:
            entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            return place + f'fullinertia="{_words(entries)}"/>'
        return place + f'diaginertia="{_words(np.linalg.eigvalsh(inertia))}" euler="{self.numbers(3, 1.0)}"/>'

    def numbers(self, count: int, size: float) -> str:
        return _words(self.rng.normal(size=count) * size)


def _words(numbers: object) -> str:
    return " ".join(repr(float(number)) for number in np.atleast_1d(np.asarray(numbers)))
