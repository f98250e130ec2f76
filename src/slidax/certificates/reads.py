"""What a certificate reads of a scenario, so that it still stands where something else was changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Asked = TypeVar("Asked", bound=Callable[..., Any])

WORLD = ("robot", "trajectory", "start", "disturbance", "actuator")
"""Blocks of a scenario that are no part of its law."""


def reads(*roots: str) -> Callable[[Asked], Asked]:
    """Declares beside a certificate what it reads; one that declares nothing reads all.

    A test moves all numbers of scenarios that are not below these, and asks for the same verdict.

    - `roots`: paths, such as `scheme` or `simulation.period`, with all that is below them.
    """

    def declared(certificate: Asked) -> Asked:
        certificate.reads = roots  # type: ignore[attr-defined]
        return certificate

    return declared


def reads_any(certificate: Callable[..., Any], path: str) -> bool:
    """Whether a certificate may read what is at a path, or below it.

    - `certificate`: of a scenario.
    - `path`: of a number, as of `--set`.
    """
    roots: tuple[str, ...] | None = getattr(certificate, "reads", None)
    return roots is None or any(f"{path}.".startswith(f"{root}.") or root.startswith(f"{path}.") for root in roots)
