"""Tables of docs/identification.md on tools that are changed."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import mujoco
import numpy as np
import yaml
from scipy import signal
from scipy.spatial.transform import Rotation

import slidax as sx
from slidax.arms import Articulated, Payload
from slidax.core import as_array
from slidax.identify import JointLog, excite, identify
from slidax.identify.regressor import JointMotion
from slidax.plant import Constant
from slidax.simulation.mujoco_model import STIFF, build
from slidax.simulation.plant import MujocoPlant, principal

ARMS = {"panda": 3.0, "ur5e": 5.0, "iiwa14": 8.0}
"""Arms with the largest mass of their tools [kg]."""

SECONDS, RATE, RESOLUTION, TORQUE_NOISE = 20.0, 500, 1e-5, 0.01
"""Duration [s] and samples per second [Hz] of a log, resolution of its positions [rad], and standard deviation of its
torque noise as a share of each joint's root mean square."""

DRIVES = ((1e-3, 3e-3), (0.01, 0.03), (5e-3, 0.02))
"""Ranges of rotor inertia [kg m²], Coulomb friction [N m] and viscous friction [N m s/rad], over the torque limit."""

NUMBERS = ("payload.mass", *(f"payload.center.{axis}" for axis in "xyz"))


def random_tool(name: str, number: int) -> Articulated:
    """An arm with random rotors and friction that carries a box; the same number gives the same arm and tool."""
    random = np.random.default_rng(number)
    arm = getattr(sx.arms, name)()
    rated = np.asarray(arm.limits.torque)
    mass, sides = random.uniform(0.1, 1.0) * ARMS[name], random.uniform(0.03, 0.1, 3)
    center = as_array([*random.uniform(-0.05, 0.05, 2), random.uniform(0.03, 0.15)])
    payload = Payload(
        mass=as_array(mass), center=center, inertia=as_array(mass / 3 * np.diag(sides @ sides - sides**2))
    )
    drives = [as_array(random.uniform(*share, arm.joints) * rated) for share in DRIVES]
    where = lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.payload)  # noqa: E731
    changed: Articulated = eqx.tree_at(where, arm, (*drives, payload))
    return changed


def recorded(arm: Articulated, motion: JointMotion, seed: int) -> JointLog:
    """The log of a motion: torques by MuJoCo's inverse dynamics with Coulomb friction, encoders and noise."""
    compiled = build(MujocoPlant(arm, Constant(value=np.zeros(arm.joints))), arm, None, free=False, timestep=1e-3)
    data = mujoco.MjData(compiled.model)
    tau = np.empty_like(motion.q)
    for k, (q, dq, ddq) in enumerate(zip(*motion, strict=True)):
        data.qpos[compiled.positions], data.qvel[compiled.dofs], data.qacc[compiled.dofs] = q, dq, ddq
        mujoco.mj_inverse(compiled.model, data)
        tau[k] = data.qfrc_inverse[compiled.dofs]
    tau += np.sign(motion.dq) * np.asarray(arm.coulomb)
    noise = TORQUE_NOISE * np.sqrt(np.mean(tau**2, axis=0))
    tau += noise * np.random.default_rng(seed).normal(size=tau.shape)
    t = np.arange(len(tau)) / RATE
    return JointLog("a tool", arm.joint_names, t, RESOLUTION * np.round(motion.q / RESOLUTION), tau)


def motion_for(name: str) -> JointMotion:
    """The excitation motion of an arm with its largest tool, as `slidax excite --seed 1` computes it."""
    table = excite(getattr(sx.arms, name)(), seed=1, duration=SECONDS, payload=Payload(mass=ARMS[name]), rate=RATE)
    return JointMotion(*(part[: int(SECONDS * RATE)] for part in table.motion))


def numbers_of(payload: Payload) -> np.ndarray:
    """Mass [kg] and centre [m] of a payload, [4]."""
    return np.array([float(payload.mass), *np.asarray(payload.center)])


def measure_tools() -> None:
    """Identify random tools on three arms, for docs/identification.md."""
    parser = argparse.ArgumentParser(description=measure_tools.__doc__)
    parser.add_argument("--tools", type=int, default=200, help="tools per arm")
    count = parser.parse_args().tools
    print(
        "| arm | tools | mass error, median [%] | largest [%] | centre error, largest [mm] | "
        "mass in its 95 % interval [%] | mass and centre [%] | time [s] |\n|---|---:|---:|---:|---:|---:|---:|---:|"
    )
    for name in ARMS:
        motion, rows, inside, seconds = motion_for(name), [], [], []
        for number in range(count):
            arm = random_tool(name, number)
            log = recorded(arm, motion, number)
            started = time.perf_counter()
            values, half = by_slidax(getattr(sx.arms, name)(), log)
            seconds.append(time.perf_counter() - started)
            off = np.abs(values - numbers_of(arm.payload))
            rows.append([100 * off[0] / float(arm.payload.mass), 1e3 * off[1:].max()])
            inside.append(off <= half)
            if number % 20 == 19:
                print(name, number + 1, np.max(rows, axis=0), np.mean(inside, axis=0), file=sys.stderr, flush=True)
        cells: list[Any] = [np.median(rows, axis=0)[0], *np.max(rows, axis=0)]
        shares = 100 * np.mean(inside, axis=0)[0], 100 * np.mean(inside)
        print(
            f"| {name} | {count} | "
            + " | ".join(f"{value:.2g}" for value in cells)
            + f" | {shares[0]:.1f} | {shares[1]:.1f} | {np.median(seconds):.2f} |"
        )


CHUNK, CUT = 100, 21
"""Samples of a chunk that `mujoco.sysid` simulates from its measured start, and of the filter for its velocities."""


def spec_of(arm: Articulated) -> mujoco.MjSpec:
    """The arm in MuJoCo with a motor and an encoder at each joint, and a body `payload` at its tip."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = 1.0 / RATE, np.asarray(arm.gravity_vector)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    links: list[Any] = []
    for i, parent in enumerate(arm.parents):
        where = {"pos": np.asarray(arm.translations[i]), "quat": quaternion(arm.rotations[i])}
        link = (links[parent] if parent >= 0 else spec.worldbody).add_body(**where)
        set_inertia(link, float(arm.masses[i]), arm.centers[i], np.asarray(arm.inertias[i]))
        name = arm.joint_names[i]
        link.add_joint(name=name, axis=[0, 0, 1], solref_friction=[2.0 / RATE, 1.0], solimp_friction=STIFF)
        motor = spec.add_actuator(name=f"{name}_motor", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1.0
        spec.add_sensor(
            name=f"{name}_pos",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
        links.append(link)
    tip = {"pos": np.asarray(arm.tip_translation), "quat": quaternion(arm.tip_rotation)}
    set_inertia(links[arm.tip_joint].add_body(name="payload", **tip), 1.0, [0.0, 0.0, 0.05], 2e-3 * np.eye(3))
    return spec


def set_inertia(body: Any, mass: float, center: Any, inertia: np.ndarray) -> None:
    """Give a body of MuJoCo its mass, centre and inertia."""
    moments, axes = principal(inertia)
    body.explicitinertial, body.mass, body.ipos = True, mass, np.asarray(center)
    body.inertia, body.iquat = moments, quaternion(axes)


def body_of_factor(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and second moments about it of the pseudo-inertia `e^{2α} U Uᵀ` of `mujoco.sysid`."""
    alpha, d1, d2, d3, s12, s23, s13, *center = theta
    upper = np.array([[np.exp(d1), s12, s13], [0.0, np.exp(d2), s23], [0.0, 0.0, np.exp(d3)]])
    mass = float(np.exp(2.0 * alpha))
    return mass, np.array(center), mass * upper @ upper.T


def quaternion(rotation: Any) -> np.ndarray:
    """The quaternion of a rotation matrix, w first."""
    result = np.empty(4)
    mujoco.mju_mat2Quat(result, np.asarray(rotation, float).reshape(9))
    return result


def by_mujoco(arm: Articulated, log: JointLog) -> tuple[np.ndarray, np.ndarray]:
    """Mass and centre of the payload by `mujoco.sysid`, and half of their 95 % intervals.

    Unknown are the payload's ten numbers, rotors and friction. Positions are predicted from the torques in chunks of
    the log, each from its measured start.
    """
    from mujoco import sysid

    spec = spec_of(arm)
    model = spec.compile()
    parameters = sysid.ParameterDict()
    wide = {
        "mass_bound_mult": np.array([0.05, 20.0]),
        "stretch_bound_mult": np.array([0.05, 20.0]),
        "shear_bound_off": np.array([-5.0, 5.0]),
    }

    def carry(spec: Any, value: Any) -> None:
        mass, center, spread = body_of_factor(value.value)
        set_inertia(spec.body("payload"), mass, center, np.trace(spread) * np.eye(3) - spread)

    kind = sysid.InertiaType.Pseudo
    payload = sysid.body_inertia_param(spec, model, "payload", inertia_type=kind, modifier=carry, **wide)
    parameters.add(payload)
    for name, limit in zip(arm.joint_names, np.asarray(arm.limits.torque), strict=True):
        for field, (low, high) in zip(("armature", "frictionloss", "damping"), DRIVES, strict=True):

            def change(spec: Any, value: Any, name: str = name, field: str = field) -> None:
                joint = spec.joint(name)
                joint.damping[0] = value.value[0] if field == "damping" else joint.damping[0]
                if field != "damping":
                    setattr(joint, field, value.value[0])

            start = 0.5 * (low + high) * limit
            parameters.add(sysid.Parameter(f"{name}_{field}", start, 0.0, 10.0 * start, modifier=change))
    velocity = signal.savgol_filter(log.q, CUT, 3, deriv=1, delta=1.0 / RATE, axis=0)
    smooth = signal.savgol_filter(log.q, CUT, 3, axis=0)
    # The torque between two samples is their mean.
    torque = 0.5 * (log.tau[:-1] + log.tau[1:])
    starts = range(CUT, len(log.t) - CHUNK - CUT, CHUNK)
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        [f"chunk {k}" for k in starts],
        [sysid.create_initial_state(model, smooth[k], velocity[k]) for k in starts],
        [sysid.TimeSeries.from_control_names(log.t[k : k + CHUNK], torque[k : k + CHUNK], model) for k in starts],
        [sysid.TimeSeries.from_names(log.t[k : k + CHUNK], log.q[k : k + CHUNK], model) for k in starts],
    )
    residuals = sysid.build_residual_fn(models_sequences=[sequences], resample_true=False)
    best, solution = sysid.optimize(parameters, residuals, verbose=False, max_iters=60)
    values = best.as_vector()
    _, half = sysid.calculate_intervals(residuals(values, best)[0], np.asarray(solution.jac))
    # The pseudo-inertia's factor: mass = exp(2 α), and its last column is the centre.
    mass = np.exp(2.0 * values[0])
    return np.array([mass, *values[7:10]]), np.array([mass * np.expm1(2.0 * half[0]), *half[7:10]])


CUTOFFS = (20.0, 30.0, 40.0)
"""Cut-off frequencies for figaroh's filter [Hz]: the best result of them counts."""


def urdf_of(arm: Articulated) -> str:
    """The arm without its payload as URDF."""
    lines = ['<robot name="arm"><link name="base"/>']
    for i, parent in enumerate(arm.parents):
        roll, pitch, yaw = Rotation.from_matrix(np.asarray(arm.rotations[i])).as_euler("xyz")
        place = " ".join(map(repr, np.asarray(arm.translations[i]).tolist()))
        center = " ".join(map(repr, np.asarray(arm.centers[i]).tolist()))
        inertia = np.asarray(arm.inertias[i])
        moments = " ".join(f'i{"xyz"[j]}{"xyz"[k]}="{inertia[j, k]!r}"' for j in range(3) for k in range(j, 3))
        torque, speed = float(arm.limits.torque[i]), float(arm.limits.velocity[i])
        lines.append(
            f'<link name="link{i}"><inertial><origin xyz="{center}"/><mass value="{float(arm.masses[i])!r}"/>'
            f'<inertia {moments}/></inertial></link><joint name="{arm.joint_names[i]}" type="revolute">'
            f'<parent link="{f"link{parent}" if parent >= 0 else "base"}"/><child link="link{i}"/><axis xyz="0 0 1"/>'
            f'<origin xyz="{place}" rpy="{roll!r} {pitch!r} {yaw!r}"/>'
            f'<limit lower="-9" upper="9" effort="{torque}" velocity="{speed}"/></joint>'
        )
    return "".join([*lines, "</robot>"]).replace("np.float64(", "").replace(")", "")


def by_figaroh(arm: Articulated, log: JointLog, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Mass and centre of the payload by figaroh's base parameters, and half of their 95 % intervals.

    figaroh fits the base parameters of the arm with its payload, rotors, friction and offsets, by weighted least
    squares. The payload follows by generalised least squares with their covariance, as the links are known.

    - `cutoff`: of the filter of positions [Hz].
    """
    from figaroh.identification.base_identification import BaseIdentification
    from figaroh.tools.robot import Robot

    class Identification(BaseIdentification):
        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
            rows = {"velocities": None, "accelerations": None}
            return {"timestamps": log.t, "positions": log.q, "torques": log.tau, **rows}

    problem = {"model_components": dict.fromkeys(("friction", "actuator_inertia", "joint_offset"), True)}
    filters = {"sampling_frequency": float(RATE), "cutoff_frequency": cutoff}
    names = list(arm.joint_names)
    config = {
        "robot": {"name": "arm", "properties": {"joints": {"active_joints": names}}},
        "tasks": {
            "identification": {
                "type": "dynamic_identification",
                "problem": {**problem, "qr_relative_tolerance": 1e-6},
                "signal_processing": filters,
            }
        },
    }
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        file, settings = Path(folder, "arm.urdf"), Path(folder, "arm.yaml")
        file.write_text(urdf_of(arm))
        settings.write_text(yaml.safe_dump(config))
        identification = Identification(Robot(str(file), folder), str(settings))
        identification.identif_config |= {key: list(range(arm.joints)) for key in ("act_idxq", "act_idxv")}
        identification.initialize(truncate=(CUT, len(log.t) - CUT))
        base = identification.solve(plotting=False, wls=True)
    weighted = identification.dynamic_regressor_base * identification._wls_row_weight[:, None]
    information = weighted.T @ weighted
    labels = identification._params_r_for_recon
    links = np.array(
        [
            value if name[0] in "mI" and name[:2] != "Ia" else 0.0
            for name, value in identification.standard_parameter.items()
        ]
    )
    known = dict(zip(identification.standard_parameter, links, strict=True))
    mapping = np.asarray(identification._M_matrix)
    last = names[arm.tip_joint]
    free = [
        k
        for k, name in enumerate(labels)
        if name.endswith(f"_{last}") or name.split("_")[0] in ("fv", "fs", "Ia", "off")
    ]
    unknown, rest = mapping[:, free], base - mapping @ np.array([known[name] for name in labels])
    # Directions that no torque shows stay where they are.
    covariance = np.linalg.pinv(unknown.T @ information @ unknown, rcond=1e-12, hermitian=True)
    values = covariance @ unknown.T @ information @ rest
    at = [free.index(labels.index(f"{name}_{last}")) for name in ("m", "mx", "my", "mz")]
    mass, moment = values[at[0]], values[at[1:]]
    rotation, offset = np.asarray(arm.tip_rotation), np.asarray(arm.tip_translation)
    center = rotation.T @ (moment / mass - offset)
    slope = np.vstack([[1.0, 0.0, 0.0, 0.0], rotation.T @ np.column_stack([-moment / mass, np.eye(3)]) / mass])
    spread = np.sqrt(np.diag(slope @ covariance[np.ix_(at, at)] @ slope.T))
    return np.array([mass, *center]), 1.96 * spread


def measure_sysid() -> None:
    """Identify payloads by slidax, `mujoco.sysid` and figaroh on the same logs, for docs/identification.md."""
    parser = argparse.ArgumentParser(description=measure_sysid.__doc__)
    parser.add_argument("--logs", type=int, default=4, help="logs per arm")
    parser.add_argument("--seconds", type=float, default=5.0, help="duration of a log")
    parser.add_argument("--programs", default="slidax,mujoco.sysid,figaroh", help="comma-separated")
    arguments = parser.parse_args()
    print(
        "| arm | program | mass error, largest [%] | centre error, largest [mm] | "
        "mass and centre in their 95 % intervals | time, median [s] |\n|---|---|---:|---:|---:|---:|"
    )
    for name in ("panda", "ur5e"):
        motion, base = motion_for(name), getattr(sx.arms, name)()
        motion = JointMotion(*(part[: int(arguments.seconds * RATE)] for part in motion))
        results: dict[str, list[Any]] = {program: [] for program in arguments.programs.split(",")}
        for number in range(arguments.logs):
            arm = random_tool(name, number)
            log = recorded(arm, motion, number)
            for program, rows in results.items():
                tries = []
                for cutoff in CUTOFFS if program == "figaroh" else (0.0,):
                    started = time.perf_counter()
                    values, half = by_figaroh(base, log, cutoff) if cutoff else PROGRAMS[program](base, log)
                    off = np.abs(values - numbers_of(arm.payload))
                    took = time.perf_counter() - started
                    relative = 100 * off[0] / float(arm.payload.mass)
                    tries.append((relative, 1e3 * off[1:].max(), np.sum(off <= half), took))
                rows.append(min(tries))
                print(name, number, program, rows[-1], file=sys.stderr, flush=True)
        for program, rows in results.items():
            mass, center, inside, seconds = np.array(rows).T
            cells = f"{mass.max():.2g} | {center.max():.2g} | {inside.sum():.0f} of {4 * len(rows)}"
            print(f"| {name} | {program} | {cells} | {np.median(seconds):.2g} |", flush=True)


def by_slidax(arm: Articulated, log: JointLog) -> tuple[np.ndarray, np.ndarray]:
    """Mass and centre of the payload by `identify`, and half of their 95 % intervals."""
    result = identify(log, arm)
    spread = np.concatenate([result.standard_errors(name) for name in NUMBERS])
    return numbers_of(result.robot.payload), 1.96 * spread


PROGRAMS = {"slidax": by_slidax, "mujoco.sysid": by_mujoco}
"""Programs that take a log as it is."""
