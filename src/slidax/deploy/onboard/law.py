"""The exported step and its pilot from Python, by ctypes; needs only Python and a C compiler.

This module runs by itself next to an exported law.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

GO, FINISH, STOP = 0, 1, 2
"""Action with a torque: send it; send it and end; end at once."""

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
"""Of the compiler; the answers to NaN are part of the contract, so there is no -ffast-math."""

POINTS = 256
"""Largest number of points of a trajectory, as in C."""


class Law:
    """An exported law, compiled and loaded.

    - `folder`: with `law.json` and the C files.
    - `library`: a compiled shared library; by default compiled next to the sources if they are newer.

    Raises OSError if there is no law, subprocess.CalledProcessError if it does not compile.
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
        """A pilot with the exported options and parameters."""
        return Pilot(self)

    def conditions(self, status: int) -> list[str]:
        """Names of the bits that are set in a status."""
        return [each["name"] for each in self.about["conditions"] if status & each["bit"]]

    def text(self, kind: str, number: int) -> str:
        """Text for a "phase", a "reason" or a trajectory's verdict ("taken")."""
        text: bytes = self.call(f"{kind}_text")(number)
        return text.decode()

    def call(self, name: str) -> Any:
        """A function of the library, by its name without the prefix."""
        return getattr(self.library, f"{self.prefix}_{name}")

    def _compiled(self) -> Path:
        sources = [
            self.folder / f"{self.prefix}{part}.c" for part in ("", "_scenario", "_path", "_follow", "_pilot", "_words")
        ]
        library = self.folder / f"lib{self.prefix}.so"
        newest = max(each.stat().st_mtime for each in sources)
        if not library.is_file() or library.stat().st_mtime < newest:
            compiler = os.environ.get("CC", "cc").split()
            more = os.environ.get("CFLAGS", "").split()
            # Built under a temporary name, so that a concurrent build never loads an incomplete file.
            handle, temporary = tempfile.mkstemp(suffix=".so", dir=self.folder)
            os.close(handle)
            subprocess.run([*compiler, *FLAGS, *more, *map(str, sources), "-lm", "-o", temporary], check=True)
            os.replace(temporary, library)
        return library

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
            ("pilot_take", [ctypes.POINTER(self.Trajectory)], ctypes.c_int),
        ):
            self.call(name).argtypes, self.call(name).restype = [pilot, *rest], result
        for what in ("phase", "reason", "taken"):
            self.call(f"{what}_text").argtypes = [ctypes.c_int32]
            self.call(f"{what}_text").restype = ctypes.c_char_p


class Pilot:
    """One arm's pilot: the structures of C, read and set from Python.

    `options` and `parameters` may be changed before `begin`; `report`, `reference` and `command` describe the last
    step.
    """

    def __init__(self, law: Law) -> None:
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
        """Begin at the posture `q`, rad or m; False if it or an option is invalid, with the reason in the report."""
        self._q[:] = list(q)
        return self.law.call("pilot_begin")(self._at, self._q)

    def step(self, elapsed: float, q: Sequence[float], dq: Sequence[float]) -> int:
        """Run one period; return GO, FINISH or STOP. The torque is `report.tau`.

        - `elapsed`: since the last one [s]; 0 at the first.
        - `q`, `dq`: measured positions and velocities.
        """
        self._q[:] = q
        self._dq[:] = dq
        return self._step(self._at, elapsed, self._q, self._dq)

    def rest(self) -> None:
        """Request the end: the arm comes to rest along its path."""
        self.law.call("pilot_rest")(self._at)

    def take(
        self,
        times: Sequence[float],
        q: Sequence[Sequence[float]],
        dq: Sequence[Sequence[float]] | None = None,
        ddq: Sequence[Sequence[float]] | None = None,
    ) -> str:
        """Follow a trajectory from now on, if `options.follows` is set; return "" or why it is refused.

        - `times`: of its points from now on, increasing [s].
        - `q`, `dq`, `ddq`: positions, and optional velocities and accelerations there.
        """
        if len(times) >= POINTS:
            return self.law.text("taken", 1)
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
        taken: int = self.law.call("pilot_take")(self._at, trajectory)
        return self.law.text("taken", taken) if taken else ""

    @property
    def phase(self) -> str:
        """The reference's phase on its path."""
        return self.law.phases[self.report.phase]

    @property
    def why(self) -> str:
        """Why the arm came to rest or the control stopped, with the joint."""
        text = self.law.text("reason", self.report.reason)
        return f"{text} (joint {self.report.joint})" if self.report.joint else text

    def signals(self) -> dict[str, list[float]]:
        """The law's signals at the last step, and the torque, by name; a scalar is a list of one."""
        values = {}
        for each in self.law.about["structures"]["command"]:
            value = getattr(self.command, each["name"])
            values[each["name"]] = list(value) if each["size"] else [float(value)]
        return values


def speeds(dq: Sequence[float]) -> float:
    """The largest of some speeds, 0 if none is finite.

    - `dq`: velocities.
    """
    return max((abs(value) for value in dq if math.isfinite(value)), default=0.0)


def _structure(name: str, fields: list[tuple[str, Any]]) -> Any:
    return type(name, (ctypes.Structure,), {"_fields_": fields})
