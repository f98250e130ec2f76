"""How many cases a certificate was tried on, and what came of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Counted:
    """Cases of one certificate.

    - `cases`: in which it holds, and a run, a posture or a draw was compared with its bound.
    - `exceeded`: how many of these came beyond it.
    - `nearest`: the largest share of a bound that was seen.
    - `refused`: cases that cannot be promised, for which it does not hold or the definition is refused.
    - `missed`: such cases for which it holds all the same.
    - `joints`: of the arms.
    - `again`: laws that were run again, finer, since they came beyond a bound of continuous time.
    - `notes`: what went wrong, a line each.
    """

    cases: int = 0
    exceeded: int = 0
    nearest: float = 0.0
    refused: int = 0
    missed: int = 0
    joints: set[int] = field(default_factory=set)
    again: int = 0
    notes: list[str] = field(default_factory=list)

    def kept(
        self, shares: object, joints: int, where: str = "", slack: float = 1e-6, nearest: float | None = None
    ) -> None:
        """Counts cases by the share of the bound that each came to.

        - `shares`: an array of numbers, one per case.
        - `joints`: of their arm.
        - `where`: what to say of those that came beyond it.
        - `slack`: of rounding.
        - `nearest`: the largest of those that say how sharp the bound is; of all if not given.
        """
        each = np.ravel(np.asarray(shares, float))
        beyond = ~(each <= 1.0 + slack)
        self.cases += each.size
        self.exceeded += int(beyond.sum())
        largest = float(np.max(each[np.isfinite(each)], initial=0.0)) if nearest is None else nearest
        self.nearest = max(self.nearest, largest)
        self.joints.add(joints)
        if beyond.any():
            self.notes.append(f"{where}: {int(beyond.sum())} of {each.size} beyond, {np.max(each):.6g}")

    def row(self, name: str, what: str) -> str:
        """A line of the table; empty where nothing was tried.

        - `name`: of the certificate.
        - `what`: is compared.
        """
        joints = f"{min(self.joints)} to {max(self.joints)}" if len(self.joints) > 1 else str(*self.joints)
        compared = f"{self.cases} | {self.exceeded} | {self.nearest:.3f}" if self.cases else " | | "
        unpromised = f"{self.refused} | {self.missed}" if self.refused + self.missed else " | "
        return f"| `{name}` | {what} | {joints} | {compared} | {unpromised} |"
