"""The exported law and its pilot in Python by ctypes, its log and its command-line options. Runs without slidax.

The pilot is C code between a robot's interface and the law. It generates the reference, checks the measurements and the
law's status, and brings the arm to rest or ends the control if something is wrong.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import gc
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

GO, FINISH, STOP = 0, 1, 2
"""Actions after a step: send the torque; send the torque and end the control; end the control at once."""

C_TYPES: dict[str, Any] = {
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "bool": ctypes.c_bool,
    "int32_t": ctypes.c_int32,
    "uint32_t": ctypes.c_uint32,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
}

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Compiler options; without -ffast-math, since the step's result for NaN is specified."""

POINTS = 256
"""Length of the array of a trajectory's points in C; a received trajectory must have fewer points."""


def compile_library(folder: Path, sources: Sequence[str], name: str) -> Path:
    """Compile C files to the shared library `name` in their folder, and return its path.

    A library that is newer than all C files is not compiled again.

    Raises OSError if a file or the compiler is missing, subprocess.CalledProcessError if the files do not compile.
    """
    paths, library = [folder / source for source in sources], folder / name
    newest = max(each.stat().st_mtime for each in paths)
    if not library.is_file() or library.stat().st_mtime < newest:
        compiler = os.environ.get("CC", "cc").split()
        more = os.environ.get("CFLAGS", "").split()
        # Built under a temporary name, so that a concurrent build never loads an incomplete file.
        handle, temporary = tempfile.mkstemp(suffix=".so", dir=folder)
        os.close(handle)
        subprocess.run([*compiler, *FLAGS, *more, *map(str, paths), "-lm", "-o", temporary], check=True)
        os.replace(temporary, library)
    return library


class CompiledLaw:
    """An exported law with its pilot, compiled and loaded.

    - `folder`: folder with `law.json` and the C files.
    - `library`: a compiled shared library; by default the C files are compiled, unless their library is newer.

    Raises OSError if the folder has no law, subprocess.CalledProcessError if it does not compile.
    """

    def __init__(self, folder: str | os.PathLike[str], library: str | os.PathLike[str] | None = None) -> None:
        self.folder = Path(folder)
        self.about: dict[str, Any] = json.loads((self.folder / "law.json").read_text(encoding="utf-8"))
        self.joints: int = self.about["joints"]
        self.period: float = self.about["period"]
        self.prefix: str = self.about["prefix"]
        self.phases: list[str] = self.about["phases"]
        self.real = C_TYPES[self.about["real"]]
        self.vector = self.real * self.joints
        self.library = ctypes.CDLL(str(library or self._compiled()))
        self._structures()
        self._functions()

    def pilot(self) -> Pilot:
        """Return a new pilot with the exported options and parameters."""
        return Pilot(self)

    def conditions(self, status: int) -> list[str]:
        """Return the names of the bits that are set in a status."""
        return [each["name"] for each in self.about["conditions"] if status & each["bit"]]

    def text(self, kind: str, number: int) -> str:
        """Return the text for a number of the kind "phase", "reason" or "taken" (the verdict on a trajectory)."""
        text: bytes = self.call(f"{kind}_text")(number)
        return text.decode()

    def call(self, name: str) -> Any:
        """Return a C function of the library as a ctypes function; `name` is its name without the law's prefix."""
        return getattr(self.library, f"{self.prefix}_{name}")

    def _compiled(self) -> Path:
        sources = [f"{self.prefix}{part}.c" for part in self.about["sources"]]
        return compile_library(self.folder, sources, f"lib{self.prefix}.so")

    def _structures(self) -> None:
        real, vector = self.real, self.vector
        path = [(name, real) for name in ("hold", "speed", "ramp", "amplitude", "small", "widen", "motion")]
        self.Path = _structure("Path", path)
        limits = ("lower", "upper", "speed", "torque", "rate", "torque_hold", "error_hold", "error_small", "error_full")
        counts = ("held", "lost", "outside", "limited", "void_")
        self.Options = _structure(
            "Options",
            [
                ("path", self.Path),
                *((name, vector) for name in limits),
                ("acceleration", vector),
                ("share", real),
                *((name, ctypes.c_int32) for name in counts),
                ("free", ctypes.c_bool),
                ("follows", ctypes.c_bool),
            ],
        )
        numbers = ("phase", "action", "reason", "joint", "steps", "missed", "bridged", "clipped")
        self.Report = _structure(
            "Report",
            [
                ("t", real),
                ("tau", vector),
                ("error", vector),
                ("margin", real),
                ("status", ctypes.c_uint32),
                *((name, ctypes.c_int32) for name in numbers),
            ],
        )
        self.Point = _structure("Point", [("t", real), ("q", vector), ("dq", vector), ("ddq", vector)])
        self.Trajectory = _structure(
            "Trajectory",
            [
                ("count", ctypes.c_int),
                ("velocities", ctypes.c_bool),
                ("accelerations", ctypes.c_bool),
                ("points", self.Point * POINTS),
            ],
        )
        violation = [("verdict", ctypes.c_int32), ("joint", ctypes.c_int32)]
        violation += [(name, real) for name in ("t", "value", "limit")]
        self.Violation = _structure("Violation", violation)
        self.Admission = _structure("Admission", [("violation", self.Violation), ("slowdown", real)])
        for name, members in self.about["structures"].items():
            fields = [
                (each["name"], C_TYPES[each["type"]] * each["size"] if each["size"] else C_TYPES[each["type"]])
                for each in members
            ]
            setattr(self, name.capitalize(), _structure(name.capitalize(), fields))

    def _functions(self) -> None:
        pilot = ctypes.c_void_p
        vector = ctypes.POINTER(self.real)
        self.call("pilot_size").restype = ctypes.c_size_t
        for name in ("report", "options", "reference", "command", "parameters"):
            getter = self.call(f"pilot_{name}")
            getter.argtypes, getter.restype = [pilot], ctypes.POINTER(getattr(self, name.capitalize()))
        for name, rest, result in (
            ("pilot_default", [], None),
            ("pilot_begin", [vector], ctypes.c_bool),
            ("pilot_step", [self.real, vector, vector], ctypes.c_int),
            ("pilot_rest", [], None),
            ("pilot_halt", [], None),
            ("pilot_take", [ctypes.POINTER(self.Trajectory)], ctypes.c_int),
        ):
            self.call(name).argtypes, self.call(name).restype = [pilot, *rest], result
        if self.about.get("streams"):
            self.call("pilot_stream").argtypes, self.call("pilot_stream").restype = [pilot, vector], ctypes.c_int
        parts = [ctypes.POINTER(getattr(self, name)) for name in ("Options", "Parameters", "Reference", "Trajectory")]
        self.call("admit").argtypes = [*parts, self.real, ctypes.POINTER(self.Admission)]
        self.call("nominal_torque").argtypes = [parts[1], vector, vector, vector, vector]
        self.call("nominal_torque").restype = None
        for what in ("phase", "reason", "taken"):
            self.call(f"{what}_text").argtypes = [ctypes.c_int32]
            self.call(f"{what}_text").restype = ctypes.c_char_p


class Pilot:
    """The pilot of one arm: the law with its reference path and checks. Call `begin` once, then `step` each period.

    The attributes are C structures, which Python reads and sets directly. `options` and `parameters` may be changed
    before `begin`. `report`, `reference` and `command` describe the last step.
    """

    def __init__(self, law: CompiledLaw) -> None:
        self.law = law
        self._memory = ctypes.create_string_buffer(law.call("pilot_size")())
        self._at = ctypes.addressof(self._memory)
        law.call("pilot_default")(self._at)
        self.report, self.options, self.reference, self.command, self.parameters = (
            law.call(f"pilot_{name}")(self._at).contents
            for name in ("report", "options", "reference", "command", "parameters")
        )
        self._q, self._dq = law.vector(), law.vector()
        self._step = law.call("pilot_step")

    def begin(self, q: Sequence[float]) -> bool:
        """Begin at measured positions `q` [n], rad or m; return False if they or an option are invalid, see `why`."""
        self._q[:] = list(q)
        return self.law.call("pilot_begin")(self._at, self._q)

    def step(self, elapsed: float, q: Sequence[float], dq: Sequence[float]) -> int:
        """Run one period; return the action GO, FINISH or STOP. The torque [n], N m or N, is `report.tau`.

        - `elapsed`: time since the previous period [s]; 0 at the first.
        - `q`, `dq`: measured positions and velocities [n], rad and rad/s (m and m/s for a prismatic joint).
        """
        self._q[:] = q
        self._dq[:] = dq
        return self._step(self._at, elapsed, self._q, self._dq)

    def rest(self) -> None:
        """Request the end of the motion: the arm comes to rest along its path, then `step` returns FINISH."""
        self.law.call("pilot_rest")(self._at)

    def halt(self) -> None:
        """Slow down to rest along the trajectory, without ending the control; `take` accepts a new one at any time."""
        self.law.call("pilot_halt")(self._at)

    def take(
        self,
        times: Sequence[float],
        q: Sequence[Sequence[float]],
        dq: Sequence[Sequence[float]] | None = None,
        ddq: Sequence[Sequence[float]] | None = None,
    ) -> str:
        """Follow a trajectory from now on, if `options.follows` is set; return the reason if it is rejected, else "".

        Positions and speeds are checked here. `admit` also checks accelerations and torques.

        - `times`: increasing times of the points, from now on [s]; a point at 0 must be near the current reference.
        - `q`, `dq`, `ddq`: positions of the points [points n], and optionally their velocities and accelerations.
        """
        if len(times) >= POINTS:
            return self.law.text("taken", 1)
        taken: int = self.law.call("pilot_take")(self._at, self.trajectory(times, q, dq, ddq))
        return self.law.text("taken", taken) if taken else ""

    def stream(self, q: Sequence[float]) -> str:
        """Follow streamed positions from now on, if `options.follows` is set; return the reason if rejected, else "".

        The law must have been exported with a streamed reference. Call this at any rate, each time the host sends new
        positions.

        - `q`: the host's positions [n], rad or m.
        """
        self._q[:] = q
        taken: int = self.law.call("pilot_stream")(self._at, self._q)
        return self.law.text("taken", taken) if taken else ""

    def admit(self, trajectory: Any, slowest: float = 1.0) -> Any:
        """Check a trajectory that starts at the current reference against all limits; return a C structure.

        Its `slowdown` is the factor by which the trajectory's times are multiplied, or 0 if the trajectory is rejected.
        Its `violation` has joint, time, value and limit of the first violation.

        - `trajectory`: a structure from `trajectory`; if it is slowed down, it is changed in place.
        - `slowest`: largest factor by which the trajectory may be slowed down, >= 1.
        """
        admission = self.law.Admission()
        self.law.call("admit")(self.options, self.parameters, self.reference, trajectory, slowest, admission)
        return admission

    def trajectory(
        self,
        times: Sequence[float],
        q: Sequence[Sequence[float]],
        dq: Sequence[Sequence[float]] | None = None,
        ddq: Sequence[Sequence[float]] | None = None,
    ) -> Any:
        """Return a trajectory as a C structure; the arguments are those of `take`, with fewer than `POINTS` points."""
        trajectory = self.law.Trajectory()
        trajectory.count = len(times)
        trajectory.velocities, trajectory.accelerations = dq is not None, ddq is not None
        for k, t in enumerate(times):
            point = trajectory.points[k]
            point.t = t
            point.q[:] = q[k]
            if dq is not None:
                point.dq[:] = dq[k]
            if ddq is not None:
                point.ddq[:] = ddq[k]
        return trajectory

    @property
    def phase(self) -> str:
        """Phase of the reference, such as "hold" or "motion"."""
        return self.law.phases[self.report.phase]

    @property
    def why(self) -> str:
        """Reason for which the arm came to rest or the control stopped, with the joint."""
        text = self.law.text("reason", self.report.reason)
        return f"{text} (joint {self.report.joint})" if self.report.joint else text

    def signals(self) -> dict[str, list[float]]:
        """Return the torque and the law's signals at the last step, by name; a scalar is a list with one number."""
        values = {}
        for each in self.law.about["structures"]["command"]:
            value = getattr(self.command, each["name"])
            values[each["name"]] = list(value) if each["size"] else [float(value)]
        return values


def speeds(dq: Sequence[float]) -> float:
    """Return the largest speed among the velocities `dq`; 0 if none is finite."""
    return max((abs(value) for value in dq if math.isfinite(value)), default=0.0)


def _structure(name: str, fields: list[tuple[str, Any]]) -> Any:
    return type(name, (ctypes.Structure,), {"_fields_": fields})


PER_JOINT = ("q", "dq", "tau", "q_wanted", "dq_wanted", "error")
"""Columns of the log with a number for each joint; `wanted` stands for the reference."""


class MotionLog:
    """Log of a motion in memory. It is written to a file when the motion is over, never while the arm moves.

    The column `time` is in s; `margin`, `status` and `phase` are from the pilot's report.
    """

    def __init__(self, law: CompiledLaw) -> None:
        joints = range(1, law.joints + 1)
        self.columns = ["time", *(f"{name}_{k}" for name in PER_JOINT for k in joints)]
        self.columns += ["margin", "status", "phase", "success_rate"]
        self.rows: list[tuple[float, ...]] = []

    def add(self, pilot: Pilot, q: Sequence[float], dq: Sequence[float], success_rate: float = 1.0) -> None:
        """Add a row for the period of the pilot's last step.

        - `q`, `dq`: measured positions and velocities [n].
        - `success_rate`: share of commands that arrived at the robot, as the robot counts it, 0 to 1.
        """
        report, wanted = pilot.report, pilot.reference
        self.rows.append(
            (
                report.t,
                *q,
                *dq,
                *report.tau,
                *wanted.q,
                *wanted.dq,
                *report.error,
                report.margin,
                report.status,
                report.phase,
                success_rate,
            )
        )

    def column(self, name: str) -> list[float]:
        """Return one column by its name, such as `q_1`."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the table as CSV."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(self.rows)


def load_law(parser: argparse.ArgumentParser, folder: Path) -> CompiledLaw:
    """Load the exported law of a folder, and compile it if necessary; end the program with a message if that fails."""
    try:
        return CompiledLaw(folder)
    except FileNotFoundError as error:
        missing = "a C compiler (install gcc, or set CC)" if error.filename in _compiler() else str(error.filename)
        parser.error(f"missing: {missing}")
    except (OSError, subprocess.CalledProcessError) as error:
        parser.error(f"the law in {folder} does not compile or load: {error}")


def _compiler() -> list[str]:
    return os.environ.get("CC", "cc").split()


def prepare(arguments: argparse.Namespace, pilot: Pilot) -> None:
    """Copy the command-line options of `add_path_options` to the pilot."""
    path = pilot.options.path
    for name in ("hold", "speed", "amplitude", "small", "widen", "motion"):
        value = getattr(arguments, name)
        if value is not None:
            setattr(path, name, value)
    for name in ("error_hold", "error_small", "error_full"):
        value = getattr(arguments, name)
        if value is not None:
            getattr(pilot.options, name)[:] = [value] * pilot.law.joints


def add_path_options(parser: argparse.ArgumentParser) -> None:
    """Add the command-line options for the phases of the motion, the largest allowed errors and the log file."""
    for name, unit, meaning in (
        ("hold", "S", "time for which the measured posture is held"),
        ("speed", "RAD/S", "speed of the fastest joint in the approach to the start of the motion"),
        ("amplitude", "SHARE", "amplitude of the small motion, relative to the full motion"),
        ("small", "S", "duration of the small motion"),
        ("widen", "S", "time in which the small motion grows to the full motion"),
        ("motion", "S", "duration of the full motion"),
        ("error-hold", "RAD", "largest error while the posture is held"),
        ("error-small", "RAD", "largest error in the approach and in the small motion"),
        ("error-full", "RAD", "largest error in the full motion"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar=unit, help=f"{meaning}; by default the exported value")
    parser.add_argument("--log", type=Path, help="write a log of the motion to this CSV file")


def robot_parser(description: str | None, folder: Path) -> argparse.ArgumentParser:
    """Return a parser with the options that all programs for robots share.

    - `folder`: folder of the program, with the exported law in its subfolder `law`.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address", help="network address of the robot")
    parser.add_argument("--law", type=Path, default=folder / "law", help="folder of the exported law")
    load = ("KG", "X", "Y", "Z")
    parser.add_argument("--load", type=float, nargs=4, metavar=load, help="payload: mass, kg, and its centre, m")
    parser.add_argument("--no-realtime", action="store_true", help="continue without real-time priority")
    add_path_options(parser)
    return parser


def request_real_time_priority(enforce: bool) -> None:
    """Request real-time priority, and switch garbage collection off.

    Raises OSError if the system refuses the priority and `enforce` is set.
    """
    gc.collect()
    gc.disable()
    try:
        if sys.platform != "linux":
            raise OSError("real-time priority is available on Linux only")
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))
    except OSError:
        if enforce:
            raise
