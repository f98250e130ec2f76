"""Counts of the cases of a certificate."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Counted:
    """Cases of one certificate.

    - `cases`: cases in which it holds, compared with its bound; `exceeded`: those beyond it.
    - `nearest`: the largest share of a bound.
    - `refused`: uncertifiable cases for which it does not hold or the definition is refused; `missed`: those that hold.
    - `joints`: of the arms.
    - `again`: laws that were run again with a finer integrator, because they exceeded a bound of continuous time.
    - `notes`: errors, a line each.
    """

    cases: int = 0
    exceeded: int = 0
    nearest: float = 0.0
    refused: int = 0
    missed: int = 0
    joints: set[int] = field(default_factory=set)
    again: int = 0
    notes: list[str] = field(default_factory=list)

    def kept(self, shares: object, joints: int, where: str = "", slack: float = 1e-6) -> None:
        """Count cases by the share of the bound that each reached."""
        each = np.ravel(np.asarray(shares, float))
        beyond = ~(each <= 1.0 + slack)
        self.cases += each.size
        self.exceeded += int(beyond.sum())
        self.nearest = max(self.nearest, float(np.max(each[np.isfinite(each)], initial=0.0)))
        self.joints.add(joints)
        if beyond.any():
            self.notes.append(f"{where}: {int(beyond.sum())} of {each.size} beyond, {np.max(each):.6g}")

    def row(self, name: str, what: str) -> str:
        """A line of the table; without counts if nothing was tried."""
        joints = f"{min(self.joints)} to {max(self.joints)}" if len(self.joints) > 1 else str(*self.joints)
        compared = f"{self.cases} | {self.exceeded} | {self.nearest:.3f}" if self.cases else " | | "
        unpromised = f"{self.refused} | {self.missed}" if self.refused + self.missed else " | "
        return f"| `{name}` | {what} | {joints} | {compared} | {unpromised} |"
