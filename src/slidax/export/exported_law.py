"""An exported law as a Python object, which calls the law's compiled C code through ctypes."""

from __future__ import annotations

import ctypes
import json
import subprocess
from collections.abc import Iterator, MutableMapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, count_noun, float_array, nearest_word

from .onboard.pilot import C_TYPES, compile_library


class ExportedLaw(MutableMapping[str, np.ndarray]):
    """An exported law that controls one arm. The object holds the law's memory between samples.

    It is also a mapping from the names of the law's parameters to their values; a change acts from the next step on.

    - `folder`: folder of the C project.
    - `about`: content of the project's `law.json`: joints, period, structures, conditions.
    - `library`: the project's compiled code.
    """

    def __init__(self, folder: str | Path, about: dict[str, Any], library: ctypes.CDLL) -> None:
        self.folder, self.about, self._library = folder, about, library
        self._real = C_TYPES[about["real"]]
        self._vector, self._reference = self._real * self.joints, self._real * (3 * self.joints)
        self._memory = ctypes.create_string_buffer(self._function("size", ctypes.c_size_t)())
        self._at = ctypes.c_void_p(ctypes.addressof(self._memory))
        self._step = self._function("step", ctypes.c_uint32)
        self._function("default", None)(self._at)
        self._parameters, self._command = (self._structure(name) for name in ("parameters", "command"))
        self._sizes = {each["name"]: each["size"] for each in about["structures"]["parameters"]}

    @property
    def joints(self) -> int:
        """The number of joints."""
        return int(self.about["joints"])

    @property
    def period(self) -> float:
        """Sample time [s]."""
        return float(self.about["period"])

    def step(
        self, t: float, q: Sequence[float], dq: Sequence[float], now: Any, following: Any = None
    ) -> tuple[np.ndarray, int]:
        """Run the law for one sample; return the torque [n], N m or N, and the status bits.

        - `t`: time of the sample [s].
        - `q`, `dq`: measured positions and velocities [n], rad and rad/s (m and m/s for a prismatic joint).
        - `now`: reference at this sample, [3 n]: rows with position, velocity and acceleration.
        - `following`: reference one period later, as `now`; by default `now` continued at constant acceleration.

        Raises DefinitionError if an argument has the wrong shape.
        """
        wanted = self._numbers(now, "now", 3)
        if following is None:
            h, (position, velocity, acceleration) = self.period, wanted
            following = (
                position + h * velocity + 0.5 * h * h * acceleration,
                velocity + h * acceleration,
                acceleration,
            )
        later, tau = self._numbers(following, "following", 3), self._vector()
        vectors = [self._vector(*self._numbers(value, name)) for name, value in (("q", q), ("dq", dq))]
        references = [self._reference(*rows.ravel()) for rows in (wanted, later)]
        status = self._step(self._at, self._real(t), *vectors, *references, tau)
        return np.array(tau, float), int(status)

    def follow(
        self, t: float, q: Sequence[float], dq: Sequence[float], newest: Any = None
    ) -> tuple[np.ndarray, int, np.ndarray]:
        """Run the law for one sample of a streamed reference; return torque [n], status bits and reference [3 n].

        A filter in the law computes the reference from the host's positions. It starts at rest at the first `q`. The
        rows of the reference are position, velocity and acceleration.

        - `t`, `q`, `dq`: as in `step`.
        - `newest`: the host's positions [n] if they have arrived since the last sample, else None.

        Raises DefinitionError if the law was exported without a streamed reference, or an argument has the wrong shape.
        """
        if not self.about.get("streams"):
            raise DefinitionError("this law has no streamed reference: export a scenario whose motion is `streamed`")
        vectors = [self._vector(*self._numbers(value, name)) for name, value in (("q", q), ("dq", dq))]
        sent = None if newest is None else self._vector(*self._numbers(newest, "newest"))
        wanted, tau = self._reference(), self._vector()
        status = self._function("follow", ctypes.c_uint32)(self._at, self._real(t), *vectors, sent, wanted, tau)
        return np.array(tau, float), int(status), np.array(wanted, float).reshape(3, self.joints)

    def reset(self) -> None:
        """Clear the state: the next good sample starts the law."""
        self._function("reset", None)(self._at)

    def another(self) -> ExportedLaw:
        """Return the same law for another arm, with a memory of its own and default parameters."""
        return ExportedLaw(self.folder, self.about, self._library)

    def conditions(self, status: int) -> list[str]:
        """Return the names of the bits that are set in a status."""
        return [each["name"] for each in self.about["conditions"] if status & each["bit"]]

    @property
    def signals(self) -> dict[str, np.ndarray]:
        """Torque and signals of the law at the last step, by name."""
        members = self.about["structures"]["command"]
        return {each["name"]: np.array(getattr(self._command, each["name"]), float) for each in members}

    def __getitem__(self, name: str) -> np.ndarray:
        return np.array(getattr(self._parameters, self._known(name)), float)

    def __setitem__(self, name: str, value: Any) -> None:
        size = self._sizes[self._known(name)]
        numbers = float_array(name, value)
        if numbers.shape not in (((), (1,), (size,)) if size else ((),)):
            expected = f"one number or {size} numbers" if size > 1 else "one number"
            shape = f"shape {list(numbers.shape)}" if numbers.ndim > 1 else count_noun(numbers.size, "number")
            raise DefinitionError(f"`{name}` must be {expected}; got {shape}")
        setattr(self._parameters, name, tuple(np.broadcast_to(numbers, size).tolist()) if size else float(numbers))

    def get(self, name: str, default: Any = None) -> Any:
        """Return a parameter's value, or `default` if the law has no such parameter."""
        if name not in self:
            return default
        return self[name]

    def __delitem__(self, name: str) -> None:
        raise DefinitionError(f"the parameter `{name}` is part of the exported law and cannot be removed")

    def __contains__(self, name: object) -> bool:
        return name in self._sizes

    def __iter__(self) -> Iterator[str]:
        return iter(self._sizes)

    def __len__(self) -> int:
        return len(self._sizes)

    def _known(self, name: str) -> str:
        if name not in self._sizes:
            raise DefinitionError(f"unknown parameter `{name}`; {nearest_word(name, self._sizes)}")
        return name

    def _numbers(self, value: Any, name: str, *rows: int) -> np.ndarray:
        numbers, shape = float_array(name, value), (*rows, self.joints)
        if numbers.shape != shape:
            raise DefinitionError(f"`{name}` must have shape {list(shape)}; got {list(numbers.shape)}")
        return numbers

    def _function(self, name: str, result: Any) -> Any:
        function = getattr(self._library, f"{self.about['prefix']}_flat_{name}")
        function.restype = result
        return function

    def _structure(self, name: str) -> Any:
        fields = [
            (each["name"], C_TYPES[each["type"]] * each["size"] if each["size"] else C_TYPES[each["type"]])
            for each in self.about["structures"][name]
        ]
        kind: Any = type(name.capitalize(), (ctypes.Structure,), {"_fields_": fields})
        return self._function(name, ctypes.POINTER(kind))(self._at).contents


def load_export(folder: str | Path) -> ExportedLaw:
    """Load an exported law; its C code is compiled once, by `$CC` or `cc`.

    - `folder`: folder of a C project, or of an export for a robot with the law in its folder `law`.

    Raises DefinitionError if there is no export or it does not compile.
    """
    project = next((path for path in (Path(folder), Path(folder) / "law") if (path / "law.json").is_file()), None)
    if project is None:
        raise DefinitionError(
            f"`{folder}` has no exported law (law.json): export one with `slidax export c SCENARIO --out DIR`"
        )
    about = json.loads((project / "law.json").read_text(encoding="utf-8"))
    prefix = about["prefix"]
    try:
        sources = ["", "_flat", *(["_stream"] if about.get("streams") else [])]
        library = compile_library(project, [f"{prefix}{each}.c" for each in sources], f"lib{prefix}_flat.so")
    except FileNotFoundError as error:
        raise DefinitionError(
            f"`{error.filename}` is missing: install a C compiler or set CC, or export again"
        ) from None
    except subprocess.CalledProcessError as error:
        raise DefinitionError(f"the law in `{project}` does not compile: {error}") from None
    return ExportedLaw(project, about, ctypes.CDLL(str(library)))
