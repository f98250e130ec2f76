"""OpenArm in MuJoCo behind its motors' frames: position control with stock gains, and an exported law."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import yaml

import slidax as sx
from slidax.export.can_motors import MOTORS, CanMotor, export_can
from slidax.scenarios import draft, load

from .shared import table, write_table

ARM = "openarm_left.urdf in wei-hsuan-cheng/robot_descriptions"
TIP = "hand"
NAMES = ["DM8009", "DM8009", "DM4340", "DM4340", "DM4310", "DM4310", "DM4310"]
KP = np.array([70.0, 70.0, 70.0, 60.0, 10.0, 10.0, 10.0])
KD = np.array([2.75, 2.5, 2.0, 2.0, 0.7, 0.6, 0.5])
"""Gains in the hardware interface of enactic/openarm_ros2."""

RATE, SUBSTEPS = 500.0, 20
"""Hz, and steps of MuJoCo and of the motors' own loop in a period."""

FRICTION = 0.1
"""N m of Coulomb friction in each joint that nobody was told of."""

MOVES, MOVING, RESTING = 8, 2.0, 2.0
"""Number of moves, and seconds of each and of the rest after it."""

Controller = Callable[[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray], Callable[..., np.ndarray]]


def rounded(values: np.ndarray, most: np.ndarray, bits: int) -> np.ndarray:
    """Values as a motor's frame holds them: in ± `most`, in `bits` bits."""
    unit = 2.0 * most / (2**bits - 1)
    return np.round((np.clip(values, -most, most) + most) / unit) * unit - most


def plant(path: Path, armature: np.ndarray, payload: float) -> mujoco.MjModel:
    """MuJoCo's own reading of the file, with closed fingers, rotors and friction, and a payload between the fingers."""
    root = ElementTree.parse(path).getroot()
    for link in root.iter("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    for joint in root.iter("joint"):
        if joint.get("type") == "prismatic":
            joint.set("type", "fixed")
            for mimic in joint.findall("mimic"):
                joint.remove(mimic)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.compiler.fusestatic = False
    spec.option.timestep = 1.0 / RATE / SUBSTEPS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint, rotor in zip(spec.joints, armature, strict=True):
        joint.armature, joint.frictionloss = float(rotor), FRICTION
    if payload:
        carried = spec.body("hand_tcp").add_body(name="payload")
        carried.explicitinertial, carried.mass, carried.inertia = True, payload, [4e-4 * payload] * 3
    return spec.compile()


def reference_of(home: np.ndarray, spread: np.ndarray, seed: int) -> Callable[[float], np.ndarray]:
    """Moves from rest to rest of the fifth order between random postures near `home`: rows q, dq, ddq over time."""
    rng = np.random.default_rng(seed)
    ends = [home, *(home + rng.uniform(-1.0, 1.0, home.size) * spread for _ in range(MOVES))]

    def reference(t: float) -> np.ndarray:
        index = min(int(t // (MOVING + RESTING)), MOVES - 1)
        s = min((t - index * (MOVING + RESTING)) / MOVING, 1.0)
        step = ends[index + 1] - ends[index]
        shapes = (
            10 * s**3 - 15 * s**4 + 6 * s**5,
            (30 * s**2 - 60 * s**3 + 30 * s**4) / MOVING,
            (60 * s - 180 * s**2 + 120 * s**3) / MOVING**2,
        )
        return np.stack([ends[index] + shapes[0] * step, shapes[1] * step, shapes[2] * step])

    return reference


def stock(t: float, q: np.ndarray, dq: np.ndarray, now: np.ndarray, following: np.ndarray) -> Callable[..., np.ndarray]:
    """The stock command: position and velocity, with gains, for the motor's own loop."""
    return lambda q, dq: KP * (now[0] - q) + KD * (now[1] - dq)


def errors(model: mujoco.MjModel, motors: list[CanMotor], controller: Any, reference: Any) -> tuple[float, float]:
    """Largest error at rest, in the last half second of each rest, and RMS of the worst joint in motion [rad]."""
    most = {name: np.array([getattr(motor, name) for motor in motors]) for name in ("position", "speed", "torque")}
    data = mujoco.MjData(model)
    data.qpos[:] = reference(0.0)[0]
    h = 1.0 / RATE
    mujoco.mj_forward(model, data)
    before = (data.qpos.copy(), data.qvel.copy())
    largest, squares = 0.0, []
    for k in range(round(MOVES * (MOVING + RESTING) * RATE)):
        # A motor answers a torque with its state, which is used one period later.
        measured = rounded(before[0], most["position"], 16), rounded(before[1], most["speed"], 12)
        before = data.qpos.copy(), data.qvel.copy()
        error = np.abs(data.qpos - reference(k * h)[0])
        phase = (k * h) % (MOVING + RESTING)
        if phase >= MOVING + RESTING - 0.5:
            largest = max(largest, float(np.max(error)))
        elif phase < MOVING:
            squares.append(error**2)
        command = controller(k * h, *measured, reference(k * h), reference((k + 1) * h))
        for _ in range(SUBSTEPS):
            data.qfrc_applied[:] = np.clip(command(data.qpos, data.qvel), -most["torque"], most["torque"])
            mujoco.mj_step(model, data)
    return largest, float(np.max(np.sqrt(np.mean(squares, axis=0))))


def measure_openarm() -> None:
    """Compare stock gains and an exported law on OpenArm in MuJoCo, without and with a payload of 0.5 kg."""
    parser = argparse.ArgumentParser(description=measure_openarm.__doc__)
    parser.add_argument("file", type=Path, help=ARM)
    options = parser.parse_args()
    motors = [MOTORS[name] for name in NAMES]
    with tempfile.TemporaryDirectory() as folder:
        scenario_file = Path(folder) / "arm.yaml"
        scenario_file.write_text(draft(options.file.resolve(), RATE, tip=TIP, folder=folder).text, encoding="utf-8")
        speed = [2.0 * motor.speed / 4095 for motor in motors]
        sensor = {"resolution": 0.00038, "velocity": "measured", "velocity_noise": [each / 12**0.5 for each in speed]}
        scenario = load(scenario_file, {"sensor": {**sensor, "delay": 1}})
        export_can(scenario, Path(folder) / "can", motors=NAMES, name="law", golden=False)
        law = sx.load_export(Path(folder) / "can")
        written = yaml.safe_load(scenario_file.read_text(encoding="utf-8"))
    most = np.array([motor.torque for motor in motors])

    def exported(t: float, q: np.ndarray, dq: np.ndarray, now: np.ndarray, following: np.ndarray) -> Any:
        tau = rounded(law.step(t, q, dq, now, following)[0], most, 12)
        return lambda q, dq: tau

    trajectory = written["trajectory"]
    reference = reference_of(np.array(trajectory["offset"]), np.array(trajectory["amplitude"]), seed=0)
    rows = []
    for payload in (0.0, 0.5):
        model = plant(options.file, np.array(written["robot"]["plant"]["armature"]), payload)
        for name, controller in (("stock gains", stock), ("exported law", exported)):
            law.reset()
            rest, moving = errors(model, motors, controller, reference)
            rows.append([f"{name}, {payload:g} kg", f"{1e3 * rest:.2f}", f"{1e3 * moving:.2f}"])
    head = ["controller, payload", "largest error at rest [mrad]", "RMS in motion, worst joint [mrad]"]
    write_table("targets.md", "openarm", table(head, rows))
