"""Adversarial runs from a scenario to its exported law, with an arm simulation that shares no code with slidax."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import slidax as sx
from slidax.certify.motion.admission import MotionAdmission, admit, certified_law
from slidax.certify.motion.certified_law import CertifiedLaw
from slidax.certify.motion.drive_limits import drive_bounds
from slidax.certify.motion.joint_loop import OUTPUTS
from slidax.certify.motion.tracking_bound import CertifiedPath, certified_path
from slidax.export.c_project import STEP, project, write_files

from .cases import desired
from .plant import ArmStruct, Chain

KINDS = ("error", "velocity", "torque", "step", "estimate")
SUB = 2
PATTERNS = 24

AFTER = 0.1
"""Time at rest after the motion, s."""

REJECTED, LIMITED, VOID = 256, 32, 128
"""Bits of the exported step's status."""

Draw = Callable[[Chain, np.random.Generator], Chain]


def compiled(scenario: Any, folder: Path) -> Any:
    """Compile the C code that `slidax export c` writes for a scenario's law, with the arm of campaign.c."""
    write_files(project(scenario, name="law", with_golden=False), folder, STEP)
    binary, source = folder / "campaign.so", Path(__file__).with_name("campaign.c")
    include = [f"-I{folder}", f"-I{source.parent}"]
    subprocess.run(["cc", "-O2", "-w", "-shared", "-fPIC", *include, "-o", binary, source, "-lm"], check=True)
    return ctypes.CDLL(str(binary))


@dataclass
class Target:
    """A law and a motion with its bounds, and the exported law compiled against the arm of campaign.c."""

    law: CertifiedLaw
    certified: CertifiedPath
    answer: MotionAdmission
    bounds: np.ndarray
    desired: np.ndarray
    library: Any = field(repr=False)

    @classmethod
    def of(cls, scenario: Any, motion: Any, library: Any, allowed: Any = None) -> Target | None:
        """Return the target if the motion is admitted."""
        law = certified_law(scenario)
        answer = admit(law, motion, allowed=allowed, slow_down=False)
        if not answer.admitted:
            return None
        certified = certified_path(
            law.arm, motion, law.loop, law.uncertainty, bodies=law.bodies, hand_over=law.hand_over
        )
        drives = drive_bounds(law.arm, certified.solution)
        values = {
            "error": certified.bounds.error,
            "velocity": certified.bounds.velocity,
            "torque": drives.torque,
            "step": drives.step,
            "estimate": certified.bounds.outputs["estimate"],
        }
        bounds = np.repeat(np.stack([values[name] for name in KINDS], axis=1), certified.path.cells.per_cell, axis=0)
        bounds = bounds[: int((float(motion.times[-1]) + AFTER) / law.loop.period)]
        reference = desired(motion, law.loop.period, len(bounds), SUB, 0)
        return cls(law, certified, answer, np.ascontiguousarray(bounds), reference, library)

    @property
    def joints(self) -> int:
        return self.law.arm.joints

    @property
    def held(self) -> np.ndarray:
        """Torque before the first command: the nominal arm's gravity torque."""
        start = jnp.asarray(self.desired[0, 0])
        return np.asarray(self.law.arm.bias(start, jnp.zeros_like(start)))

    def choices(self, rng: np.random.Generator, runs: int, members: int) -> np.ndarray:
        """Draw the disturbances of each run: all at their bounds, or zero for some joints."""
        n, inputs = self.joints, self.certified.inputs
        result = np.zeros(runs, choice_type(n))
        result["member"] = rng.integers(members, size=runs)
        result["pattern"] = np.where(rng.random(runs) < 0.3, -1, rng.integers(PATTERNS, size=runs))
        size = np.where(rng.random((runs, 1)) < 0.7, 1.0, rng.choice([0.0, 1.0], size=(runs, n)))
        result["coulomb"] = size * inputs.coulomb
        result["push"] = size * inputs.torque
        result["phase"] = rng.random((runs, n))
        corners = rng.choice([-1.0, 1.0], size=(2, runs, n))
        result["start"] = np.stack([corners[0] * inputs.start_error, corners[1] * inputs.start_speed], axis=1)
        return result

    def patterns(self, rng: np.random.Generator) -> np.ndarray:
        """Signs of the disturbance: those of the kernels at some instants, reversals together, and random ones."""
        slots, n, loop = len(self.bounds), self.joints, self.law.loop
        result = np.empty((PATTERNS, slots * SUB, n), np.int8)
        maps = loop.maps_for(1.0)
        # A constant w for one period.
        state, responses = 0.5 * maps.enters[:, 1] + maps.enters[:, 2], []
        for _ in range(slots):
            responses.append(maps.outputs @ state)
            state = maps.step @ state
        signs = np.where(np.array(responses) >= 0.0, 1, -1)
        for k in range(PATTERNS):
            if k % 3 == 2:
                pace = int(rng.integers(2, 60))
                each = rng.choice([-1, 1], size=(slots * SUB // pace + 1, n if rng.random() < 0.7 else 1))
                result[k] = np.repeat(each, pace, axis=0)[: slots * SUB]
                continue
            # Maximise the response of a single joint at one instant, in half of the cases where its bound is largest.
            output = list(OUTPUTS).index(rng.choice(["error", "error", "velocity", "command", "estimate"]))
            joint = int(rng.integers(n))
            last = int(np.argmax(self.bounds[:, 0, joint])) if k % 3 == 0 else int(rng.integers(slots // 3, slots))
            q = jnp.asarray(self.desired[last * SUB, 0])
            towards = np.sign(np.linalg.inv(np.asarray(self.law.arm.mass(q)))[joint])
            ages = np.maximum(last - 1 - np.arange(slots), 0)
            result[k] = np.repeat(signs[ages, output][:, None] * towards, SUB, axis=0)
        return result

    def run(
        self,
        members: list[Chain],
        choices: np.ndarray,
        patterns: np.ndarray,
        allowed: Any = np.inf,
    ) -> np.ndarray:
        """Run all choices; the outcomes as in campaign.c."""
        n, slots = self.joints, len(self.bounds)
        arms = (ArmStruct * len(members))(*(member.struct() for member in members))
        outcomes = np.zeros(len(choices), OUTCOME)
        resolution = np.broadcast_to(np.asarray(self.certified.inputs.resolution, float), n).copy()
        arrays = {
            "desired": np.ascontiguousarray(self.desired),
            "patterns": np.ascontiguousarray(patterns, np.int8),
            "resolution": resolution,
            "bounds": self.bounds,
            "held": np.ascontiguousarray(self.held),
            "allowed": np.broadcast_to(np.asarray(allowed, float), n).copy(),
        }
        pointers = {name: values.ctypes.data_as(ctypes.c_void_p) for name, values in arrays.items()}
        self.library.campaign(
            arms,
            len(choices),
            choices.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_double(self.law.loop.period),
            self.law.loop.delay,
            slots,
            SUB,
            pointers["desired"],
            pointers["patterns"],
            pointers["resolution"],
            pointers["bounds"],
            pointers["held"],
            pointers["allowed"],
            outcomes.ctypes.data_as(ctypes.c_void_p),
        )
        return outcomes

    def attack(
        self,
        rng: np.random.Generator,
        draw: Draw,
        runs: int,
        members: int = 64,
        allowed: Any = np.inf,
        larger: tuple[float, float] = (1.0, 1.0),
    ) -> np.ndarray:
        """Run members of the set under random disturbances.

        - `larger`: range of a factor on friction and disturbance.
        """
        nominal, choices = Chain.of(self.law.arm), self.choices(rng, runs, members)
        factor = rng.uniform(*larger, size=(runs, 1))
        choices["coulomb"] *= factor
        choices["push"] *= factor
        return self.run([draw(nominal, rng) for _ in range(members)], choices, self.patterns(rng), allowed)


def choice_type(n: int) -> np.dtype:
    """`choice_t` of campaign.c."""
    numbers = [("coulomb", float, n), ("push", float, n), ("phase", float, n), ("start", float, (2, n))]
    return np.dtype([("member", np.int32), ("pattern", np.int32), *numbers])


OUTCOME = np.dtype(
    [
        ("worst", float, len(KINDS)),
        ("alarm", float),
        ("left", float),
        ("status", np.uint32),
        ("rejected", np.int32),
    ]
)


def chain_urdf(n: int, rng: np.random.Generator, sliding: tuple[int, ...] = ()) -> str:
    """An arm of n joints with random proportions; the joints `sliding` are prismatic."""
    parts, previous = ['<robot name="chain"><link name="base"/>'], 0.2
    for i in range(n):
        axis = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "0 1 0"][i]
        length, mass = rng.uniform(0.15, 0.4), rng.uniform(1.0, 5.0) / (1.0 + 0.5 * i)
        # A solid box around the centre of mass.
        sizes = rng.uniform(0.05, 0.15, size=3) + np.array([0.0, 0.0, 0.6 * length])
        inertia = mass / 12.0 * (np.sum(sizes**2) - sizes**2)
        center = " ".join(f"{value:.4f}" for value in (*rng.uniform(-0.03, 0.03, size=2), 0.5 * length))
        kind = "prismatic" if i in sliding else "revolute"
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{"base" if i == 0 else f"l{i - 1}"}"/>'
            f'<child link="l{i}"/><origin xyz="0 0.02 {previous:.4f}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.5" upper="2.5" effort="200" velocity="3"/></joint>'
            f'<link name="l{i}"><inertial><origin xyz="{center}"/><mass value="{mass:.4f}"/>'
            f'<inertia ixx="{inertia[0]:.6f}" iyy="{inertia[1]:.6f}" izz="{inertia[2]:.6f}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
        previous = length
    return "\n".join([*parts, "</robot>"])


def scenario_of(text: str, folder: Path) -> Any:
    """Load a scenario from its text, with a folder for the files that it names."""
    (folder / "scenario.yaml").write_text(text)
    return sx.scenarios.load(str(folder / "scenario.yaml"))
