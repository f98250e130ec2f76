"""An arm under the certified law that shares no code with slidax (attack.c), for adversarial runs."""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

LARGEST = 8


class ArmStruct(ctypes.Structure):
    _fields_ = [
        ("n", ctypes.c_int),
        ("revolute", ctypes.c_int * LARGEST),
        ("rot", ctypes.c_double * 9 * LARGEST),
        ("pos", ctypes.c_double * 3 * LARGEST),
        ("mass", ctypes.c_double * LARGEST),
        ("com", ctypes.c_double * 3 * LARGEST),
        ("inertia", ctypes.c_double * 9 * LARGEST),
        ("rotor", ctypes.c_double * LARGEST),
        ("viscous", ctypes.c_double * LARGEST),
        ("gravity", ctypes.c_double * 3),
    ]


class PlanStruct(ctypes.Structure):
    _fields_ = [
        ("horizon", ctypes.c_double),
        *((name, ctypes.c_double * LARGEST) for name in ("lower", "upper", "k1", "k2", "p", "q", "delta")),
        ("now", ctypes.POINTER(ctypes.c_double)),
        ("ahead", ctypes.POINTER(ctypes.c_double)),
    ]


@dataclass(frozen=True)
class PaperPlan:
    """The paper's surface and envelope, with a plan over a horizon, all joints alike; the wide side is above zero."""

    horizon: float
    initial: float
    final: float
    deadline: float
    exponent: float = 2.01
    overshoot: float = 0.3
    k1: float = 0.5
    k2: float = 1.0
    p: float = 0.5
    q: float = 1.2
    delta: float = 0.01

    def frames(self, times: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
        """N and A at times."""
        lead, left = self.horizon - 0.5 * period, np.maximum(1.0 - times / self.deadline, 0.0)
        size, m = self.initial - self.final, self.exponent
        radius = size * left**m + self.final
        rate = -size * m / self.deadline * left ** (m - 1)
        curvature = size * m * (m - 1) / self.deadline**2 * left ** (m - 2) * (left > 0)
        now = np.maximum(radius + lead * rate, 0.1 * radius)
        return now, np.maximum(now + self.horizon * (rate + lead * curvature), 0.1 * radius)

    def struct(self, joints: int, times: np.ndarray, period: float) -> tuple[PlanStruct, list[np.ndarray]]:
        """The plan in C, and the arrays that it points to."""
        plan = PlanStruct(horizon=self.horizon)
        for name in ("k1", "k2", "p", "q", "delta"):
            getattr(plan, name)[:joints] = [getattr(self, name)] * joints
        plan.lower[:joints], plan.upper[:joints] = [-self.overshoot] * joints, [1.0] * joints
        arrays = [np.repeat(values[:, None], joints, axis=1).copy() for values in self.frames(times, period)]
        plan.now, plan.ahead = map(_pointer, arrays)
        return plan, arrays


@functools.cache
def library() -> Any:
    folder = Path(tempfile.mkdtemp())
    source = Path(__file__).with_name("attack.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", folder / "attack.so", source, "-lm"], check=True)
    return ctypes.CDLL(str(folder / "attack.so"))


@dataclass(frozen=True)
class Chain:
    """Parameters of a serial arm. Bodies are pseudo-inertias [m 4 4], each fixed to the joint `carrier`."""

    revolute: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    carrier: np.ndarray
    bodies: np.ndarray
    rotors: np.ndarray
    viscous: np.ndarray
    gravity: np.ndarray

    @classmethod
    def of(cls, arm: Any) -> Chain:
        n = arm.joints
        bodies = [
            _pseudo(float(arm.masses[i]), np.asarray(arm.centers[i]), np.asarray(arm.inertias[i])) for i in range(n)
        ]
        carrier = list(range(n))
        if float(arm.payload.mass) > 0:
            turn = np.asarray(arm.tip_rotation)
            center = np.asarray(arm.tip_translation) + turn @ np.asarray(arm.payload.center)
            bodies.append(_pseudo(float(arm.payload.mass), center, turn @ np.asarray(arm.payload.inertia) @ turn.T))
            carrier.append(arm.tip_joint)
        return cls(
            np.array([unit == "rad" for unit in arm.joint_units]),
            np.asarray(arm.rotations),
            np.asarray(arm.translations),
            np.array(carrier),
            np.stack(bodies),
            np.asarray(arm.armature, float),
            np.asarray(arm.viscous, float),
            np.asarray(arm.gravity_vector),
        )

    def struct(self) -> ArmStruct:
        n = len(self.rotors)
        arm = ArmStruct(n=n)
        for i in range(n):
            joined = self.bodies[self.carrier == i].sum(axis=0)
            mass = joined[3, 3]
            com = joined[:3, 3] / mass
            spread = joined[:3, :3] - mass * np.outer(com, com)
            inertia = np.trace(spread) * np.eye(3) - spread
            arm.revolute[i] = int(self.revolute[i])
            arm.rot[i][:] = self.rotations[i].ravel().tolist()
            arm.pos[i][:] = self.translations[i].tolist()
            arm.mass[i] = mass
            arm.com[i][:] = com.tolist()
            arm.inertia[i][:] = inertia.ravel().tolist()
            arm.rotor[i] = self.rotors[i]
            arm.viscous[i] = self.viscous[i]
        arm.gravity[:] = self.gravity.tolist()
        return arm

    def member(self, rng: np.random.Generator, p: float, *, corner: bool = True) -> Chain:
        """An arm at the edge of the band: `J = √J0 (1 + p D) √J0ᵀ` with random D of norm 1, and rotors by ± p."""
        bodies = []
        for body in self.bodies:
            values, axes = np.linalg.eigh(body)
            root = axes * np.sqrt(np.maximum(values, 0.0))
            turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
            size = rng.choice([-1.0, 1.0], size=4) if corner else rng.uniform(-1, 1, size=4)
            if corner and rng.random() < 0.5:
                size[:] = size[0]
            bodies.append(root @ (np.eye(4) + p * (turn * size) @ turn.T) @ root.T)
        rotors = self.rotors * (1 + p * rng.choice([-1.0, 1.0], size=len(self.rotors)))
        viscous = self.viscous * (1 + p * rng.choice([-1.0, 1.0], size=len(self.rotors)))
        return replace(self, bodies=np.stack(bodies), rotors=rotors, viscous=viscous)

    def deviated(self, bodies: np.ndarray, rotors: np.ndarray) -> Chain:
        """The arm with other pseudo-inertias of its links [n 4 4] and rotors [n], by these differences."""
        changed = self.bodies.copy()
        changed[: len(bodies)] += bodies
        return replace(self, bodies=changed, rotors=self.rotors + rotors)


def _pseudo(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    spread = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    result = np.empty((4, 4))
    result[:3, :3] = spread + mass * np.outer(center, center)
    result[:3, 3] = result[3, :3] = mass * center
    result[3, 3] = mass
    return result


@dataclass
class Run:
    """Largest |e| and |v| in each slot [slots n], and optionally the trace [slots sub 6 n] and the torques."""

    error: np.ndarray
    velocity: np.ndarray
    trace: np.ndarray | None
    torque: np.ndarray


def _pointer(values: np.ndarray | None) -> Any:
    return None if values is None else values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def simulate(
    truth: Chain,
    model: Chain,
    loop: Any,
    desired: np.ndarray,
    slots: int,
    sub: int,
    *,
    push: np.ndarray | None = None,
    coulomb: np.ndarray | None = None,
    resolution: float = 0.0,
    phase: np.ndarray | None = None,
    start: np.ndarray | None = None,
    settled: bool = False,
    plan: PaperPlan | None = None,
    trace: bool = False,
) -> Run:
    """Run the arm; `desired` are positions and velocities at substeps [(slots + delay + 1) sub + 1, 2, n]."""
    n = len(model.rotors)
    desired = np.ascontiguousarray(desired)
    assert desired.shape[0] >= (slots + loop.delay + 1) * sub + 1
    push = np.ascontiguousarray(np.zeros((slots * sub, n)) if push is None else push)
    grid = np.zeros(n) if phase is None else np.ascontiguousarray(phase)
    begin = np.ascontiguousarray(desired[0] if start is None else start)
    sizes = np.zeros((slots, 2, n))
    traced = np.zeros((slots, sub, 6, n)) if trace else None
    torque = np.zeros((slots, n))
    friction = np.zeros(n) if coulomb is None else np.ascontiguousarray(coulomb)
    real, unreal = truth.struct(), model.struct()
    gains = np.array(loop.gains)
    times = loop.period * np.arange(slots + loop.delay)
    sliding, kept = (None, None) if plan is None else plan.struct(n, times, loop.period)
    library().run(
        ctypes.byref(real),
        ctypes.byref(unreal),
        ctypes.c_double(loop.period),
        ctypes.c_double(loop.kp),
        ctypes.c_double(loop.kd),
        _pointer(gains),
        loop.delay,
        slots,
        sub,
        _pointer(desired),
        _pointer(push),
        int(coulomb is None),
        _pointer(friction),
        ctypes.c_double(resolution),
        _pointer(grid),
        _pointer(begin),
        int(settled),
        None if sliding is None else ctypes.byref(sliding),
        _pointer(sizes),
        _pointer(traced),
        _pointer(torque),
    )
    del kept
    return Run(sizes[:, 0], sizes[:, 1], traced, torque)
