"""A motion from rest to rest that shows an arm's numbers, as rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text

from .regressor import Motion

LIMITS = ("range", "velocity", "acceleration", "torque")
"""Whose shares there are."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """A motion from rest to rest, in rows.

    - `joints`: names of the joints.
    - `t`: times [k], s.
    - `motion`: positions, velocities, accelerations at them.
    - `share`: of the limits of position range, velocity, acceleration and torque, what each joint takes at most [4 n].
    - `information`: `½ log₂ det(1 + S A S)`, the bits by which a log of it says more of the unknown numbers than was
      believed before.
    """

    joints: tuple[str, ...]
    t: np.ndarray
    motion: Motion
    share: np.ndarray
    information: float

    def as_json(self) -> dict[str, Any]:
        """The output of `slidax excite --json`."""
        return {
            "joints": list(self.joints),
            "duration": float(self.t[-1]),
            "start": self.motion.q[0].tolist(),
            "share": dict(zip(LIMITS, self.share.tolist(), strict=True)),
            "information": self.information,
        }

    def __str__(self) -> str:
        width = max(map(len, self.joints))
        lines = [f"{self.t[-1]:g} s from rest to rest, {self.information:.0f} bits; the largest share of each limit:"]
        lines.append(f"{'':<{width}}  {'  '.join(f'{name:>12}' for name in LIMITS)}  {'start':>9}")
        for joint, name in enumerate(self.joints):
            shares = "  ".join(f"{100 * value:>10.0f} %" for value in self.share[:, joint])
            lines.append(f"{name:<{width}}  {shares}  {self.motion.q[0, joint]:>9.4f}")
        return "\n".join(lines)

    __repr__ = __str__

    def write(self, path: str | Path) -> None:
        """Writes it as the CSV file that `trajectory: {kind: csv, file: ...}` and `Tabulated.from_csv` read.

        - `path`: where to.

        Raises DefinitionError if the file cannot be written.
        """
        names = [*self.joints, *(f"{n}.velocity" for n in self.joints), *(f"{n}.acceleration" for n in self.joints)]
        rows = np.column_stack([self.t, self.motion.q, self.motion.dq, self.motion.ddq])
        lines = [",".join(["time", *names])] + [",".join(f"{value:.10g}" for value in row) for row in rows]
        try:
            write_text(Path(path), "\n".join(lines) + "\n")
        except OSError as error:
            raise DefinitionError(f"cannot write the file `{path}`: {reason(error)}") from None
