"""An exported FMU in the hands of others: what torques it gives when the samples of our own run are fed to it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.export.golden_samples import Recording
from slidax.law import AbstractController
from slidax.scenarios import Scenario
from slidax.simulation import Run, simulate

HOST = Path(__file__).with_name("fmu_host.c")
REFERENCES = ("q", "dq", "ddq")


def inputs(recording: Recording) -> dict[str, np.ndarray]:
    """The inputs of the FMU by name, a number for each sample.

    - `recording`: our own run.
    """
    samples = recording.samples
    joints = recording.tau.shape[1]
    arrays = [x for each in (samples.state, samples.now, samples.following) for x in jax.tree.leaves(each)]
    return dict(zip(input_names(joints), np.concatenate(arrays, axis=1).T, strict=True))


def input_names(joints: int) -> list[str]:
    """The names of the inputs, in the order of the arrays of a sample.

    - `joints`: how many.
    """
    arrays = ["measurement.q", "measurement.dq"]
    arrays += [f"reference.{name}{when}" for when in ("", "_next") for name in REFERENCES]
    return [f"{array}[{joint + 1}]" for array in arrays for joint in range(joints)]


def outputs(joints: int) -> list[str]:
    """The names of the torques.

    - `joints`: how many.
    """
    return [f"command.tau[{joint + 1}]" for joint in range(joints)]


def by_fmpy(file: Path, recording: Recording, period: float, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Torques [k n] and statuses [k] of FMPy's `simulate_fmu`.

    - `file`: the FMU.
    - `recording`: our own run.
    - `period`: of the step [s].
    - `options`: more of `simulate_fmu`.
    """
    import fmpy

    columns = inputs(recording)
    table = np.zeros(len(recording.tau), [("time", float), ("restart", bool), *((name, float) for name in columns)])
    table["time"] = np.arange(len(table)) * period
    for name, values in columns.items():
        table[name] = values
    names = outputs(recording.tau.shape[1])
    results = fmpy.simulate_fmu(
        str(file),
        input=table,
        output=[*names, "command.status"],
        output_interval=period,
        stop_time=(len(table) - 1) * period,
        **options,
    )
    # Values at the end of a step belong to its beginning.
    return np.stack([results[name][1:] for name in names], 1), results["command.status"][1:]


class Foreign(AbstractController):
    """A controller that somebody else computes, behind a callback: so it stands in our own loop in place of the law.

    - `answer`: from time, measured positions and velocities, and both references, each [n], to the torque [n].
    - `count`: number of joints.
    """

    answer: Callable[..., np.ndarray] = eqx.field(static=True)
    count: int = eqx.field(static=True)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.count

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """Nothing is kept on this side."""
        return jnp.zeros(())

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The other's torque."""
        shape = jax.ShapeDtypeStruct((self.count,), float)
        values = [x for each in (state, reference_now, reference_next) for x in jax.tree.leaves(each)]
        tau = jax.pure_callback(self.answer, shape, t, *values)
        return Command(tau=tau, memory=memory, signals={})

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """None that our loop could judge by."""
        return None


def in_our_loop(scenario: Scenario, answer: Callable[..., np.ndarray], t1: float) -> Run:
    """The scenario's loop with a controller of somebody else's.

    - `scenario`: the loop.
    - `answer`: as in `Foreign`.
    - `t1`: its end [s].
    """
    last: list[Any] = [None, None]

    def once(t: Any, *values: Any) -> np.ndarray:
        """A pure callback may be called more than once for one sample; a step must not."""
        if last[0] != float(t):
            last[:] = [float(t), np.asarray(answer(float(t), np.concatenate([np.asarray(x) for x in values])))]
        return last[1]

    return simulate(
        scenario.plant,
        Foreign(once, scenario.controller.joints),
        scenario.trajectory,
        scenario.state0,
        t1=t1,
        stepping=scenario.stepping,
        mode="held",
        engine="xla",
        progress=False,
    )


@contextmanager
def fmpy_steps(file: Path, joints: int, period: float) -> Iterator[Callable[..., np.ndarray]]:
    """A function from time and inputs to torques: a communication step of FMPy.

    - `file`: the FMU.
    - `joints`: of its arm.
    - `period`: of the step [s].
    """
    import fmpy

    description = fmpy.read_model_description(str(file))
    place = {each.name: each.valueReference for each in description.modelVariables}
    written, read = [place[name] for name in input_names(joints)], [place[name] for name in outputs(joints)]
    folder = fmpy.extract(str(file))
    fmu = fmpy.instantiate_fmu(folder, description, "CoSimulation")
    older = description.fmiVersion == "2.0"
    if older:
        fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()

    def step(t: float, values: np.ndarray) -> np.ndarray:
        (fmu.setReal if older else fmu.setFloat64)(written, values.tolist())
        fmu.doStep(t, period)
        return np.array((fmu.getReal if older else fmu.getFloat64)(read))

    try:
        yield step
    finally:
        fmu.terminate()
        fmu.freeInstance()
        shutil.rmtree(folder)


def libcosim_steps(file: Path, joints: int, period: float) -> Callable[..., np.ndarray]:
    """A function from time and inputs to torques: a step of libcosim.

    - `file`: the FMU, of FMI 2.0.
    - `joints`: of its arm.
    - `period`: of the step [s].
    """
    import fmpy
    from libcosimpy import CosimLogging
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    CosimLogging.log_output_level(CosimLogging.CosimLogLevel.WARNING)
    place = {each.name: each.valueReference for each in fmpy.read_model_description(str(file)).modelVariables}
    written, read = [place[name] for name in input_names(joints)], [place[name] for name in outputs(joints)]
    execution = CosimExecution.from_step_size(step_size=round(1e9 * period))
    slave = execution.add_local_slave(local_slave=CosimLocalSlave(fmu_path=str(file), instance_name="law"))
    hand, eye = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator=hand)
    execution.add_observer(observer=eye)

    def step(t: float, values: np.ndarray) -> np.ndarray:
        hand.slave_real_values(slave, written, values.tolist())
        if not execution.step():
            raise RuntimeError(f"libcosim refused the step at {t} s")
        return np.array(list(eye.last_real_values(slave, read)))

    return step


def by_host(file: Path, recording: Recording, period: float, platform: str, folder: Path) -> np.ndarray:
    """Torques [k n] of the binary for another machine, loaded by a program of ours there.

    - `file`: the FMU, of FMI 3.0.
    - `recording`: our own run.
    - `period`: of the step [s].
    - `platform`: `x86_64-windows`, which wine runs, or `aarch64-linux`, which qemu runs.
    - `folder`: to work in.
    """
    target, runner = {
        "x86_64-windows": ("x86_64-windows-gnu", ["wine"]),
        "aarch64-linux": ("aarch64-linux-gnu.2.34", ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]),
    }[platform]
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        inside = next(name for name in names if name.startswith(f"binaries/{platform}/"))
        archive.extract(inside, folder)
    import fmpy

    description = fmpy.read_model_description(str(file))
    place = {each.name: each.valueReference for each in description.modelVariables}
    columns = inputs(recording)
    host = "host.exe" if "windows" in platform else "host"
    compiled = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O1", str(HOST), "-o", host]
    subprocess.run([*compiled, *([] if "windows" in platform else ["-ldl"])], cwd=folder, check=True)
    rows = np.stack(list(columns.values()), 1)
    wanted = outputs(recording.tau.shape[1])
    lines = [
        f"{description.instantiationToken} {period!r} {len(rows)} {len(columns)} {len(wanted)}",
        " ".join(str(place[name]) for name in [*columns, *wanted]),
        *(" ".join(map(repr, row.tolist())) for row in rows),
    ]
    command = [*runner, f"./{host}" if runner != ["wine"] else host, inside]
    done = subprocess.run(
        command, cwd=folder, input="\n".join(lines), capture_output=True, text=True, check=True, timeout=300
    )
    return np.array([[float(x) for x in line.split()] for line in done.stdout.splitlines()])


def lacks(platform: str) -> str:
    """Programs that this machine lacks to run the binary of a platform; empty if none.

    - `platform`: as for `by_host`.
    """
    if platform == "x86_64-windows":
        return "" if shutil.which("wine") else "wine"
    if not shutil.which("qemu-aarch64"):
        return "qemu-user"
    return "" if Path("/usr/aarch64-linux-gnu/lib").exists() else "libc6-arm64-cross"
