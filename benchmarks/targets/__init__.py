"""The table of targets: where the exported step was compiled and run, and what it takes there (`make targets`)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One target, measured.

    - `target`: such as "Cortex-M7, double".
    - `compiled_by`, `run_by`: programs with their versions.
    - `passed`, `samples`: golden samples that agree, and all of them; None where a target has none.
    - `code`: of the step [bytes].
    - `stack`: of the step, as measured [bytes].
    - `step`: instructions or time of a step, with its unit.
    - `missing`: what this machine lacks, so that nothing was measured; "" if it was.
    """

    target: str
    compiled_by: str = ""
    run_by: str = ""
    passed: int | None = None
    samples: int | None = None
    code: int | None = None
    stack: int | None = None
    step: str = ""
    missing: str = ""
