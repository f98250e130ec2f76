"""Measured positions and torques of an arm over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slidax._errors import DefinitionError

FEWEST = 200
"""Samples that a log must have."""


@dataclass(frozen=True, eq=False)
class Log:
    """Positions and torques of all joints over time.

    The times may repeat or run backward, as they do in bags: `identify` judges them.

    - `source`: its origin, for messages.
    - `joints`: their names, in the arm's order.
    - `t`: times [k], s.
    - `q`: positions [k n], rad or m.
    - `tau`: torques [k n], N m or N.
    - `dq`: velocities [k n], rad/s or m/s; None if they were not measured.
    - `notes`: sentences about what reading left out or converted.

    Raises DefinitionError if sizes differ, the log has fewer than 200 samples, or a number is not finite.
    """

    source: str
    joints: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    dq: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k, n = len(self.t), len(self.joints)
        if k < FEWEST:
            raise DefinitionError(f"{self.source} has {k} samples: at least {FEWEST} are needed to identify anything")
        for name, values in (("q", self.q), ("tau", self.tau), ("dq", self.dq)):
            if values is None:
                continue
            if values.shape != (k, n):
                raise DefinitionError(
                    f"`{name}` of {self.source} must be {k} x {n} numbers; got shape {list(values.shape)}"
                )
            if not np.isfinite(values).all():
                row, joint = (int(index[0]) for index in np.nonzero(~np.isfinite(values)))
                raise DefinitionError(
                    f"`{name}` of {self.source} is not finite for joint `{self.joints[joint]}` in sample {row + 1}: "
                    "leave out such samples"
                )
        if not np.isfinite(self.t).all():
            row = int(np.argmin(np.isfinite(self.t)))
            raise DefinitionError(
                f"the time of sample {row + 1} of {self.source} is not finite: it is {self.t[row]:g}; "
                "leave out this sample"
            )

    def rows(self, rows: np.ndarray) -> Log:
        """Return the log with some of its samples.

        - `rows`: their numbers in the new order, or True for each that is kept.
        """
        dq = None if self.dq is None else self.dq[rows]
        return replace(self, t=self.t[rows], q=self.q[rows], tau=self.tau[rows], dq=dq)

    @property
    def period(self) -> float:
        """The median time between two samples [s]; 0 if no time advances."""
        steps = np.diff(self.t)
        return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
