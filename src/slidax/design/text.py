"""Scenario file of a design, with comments that explain its values."""

from __future__ import annotations

import json
from collections.abc import Iterator
from os.path import relpath
from pathlib import Path
from typing import Any

from slidax._writing import write_text
from slidax.certificates import Certificates, Verdict
from slidax.certificates.loop.jointly import JOINTS
from slidax.scenarios.written import dump_commented

from .design import U_AMPLE, U_OVER, Designed
from .proof import boundable
from .search import MANY

CERTIFICATE = ".certificate.json"
"""Follows the scenario's own name."""


def written(result: Designed, folder: Path) -> str:
    """Return the scenario as YAML with comments, ready for `slidax run`.

    - `folder`: of the file, from which it names other files.
    """
    values = result.description.model_dump(mode="json", exclude_unset=True)
    for name in ("robot", "trajectory"):
        values[name] = _relative(values[name], folder)
    return dump_commented(values, _comments(result))


def write_design(result: Designed, out: Path, certificates: Certificates) -> Path:
    """Write the scenario to `out` and its certificates next to it; return the path of the certificates."""
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, written(result, out.parent))
    path = out.with_name(out.stem + CERTIFICATE)
    text = json.dumps(certificates.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(path, text + "\n")
    return path


def called(rate: Verdict | None) -> str:
    """Name the proof of a design for a `loop_rate` verdict that holds: certified if all lines are proved."""
    if rate is None or rate.grade is None:
        return "tested"
    if rate.grade == "A":
        return "certified by `loop_rate`, grade A: all of its lines are proved"
    return f"tested, with a bound of `loop_rate`, grade {rate.grade}: its lines: {rate.stands_on}"


def _proof(result: Designed) -> str:
    check = result.check.bound
    text = f"Tested in simulation, not proved: {_unproved(result)}."
    if result.proof == "bound":
        name = called(result.rate)
        text = f"{name[0].upper()}{name[1:]}; the certificate file next to this one lists its lines."
    if not check:
        return f"{text} Nothing is uncertain, so that one run shows all."
    return (
        f"{text} {check['runs']} random cases of the set and {check['searched']} of a search for the worst stay "
        f"inside, the worst with {check['worst_margin']:.2g} of the envelope's width to spare."
    )


def _unproved(result: Designed) -> str:
    if boundable(result.frame.initial.size, result.frame.learns):
        return "`loop_rate` has no bound within such an envelope for this set"
    return (
        f"from {JOINTS} joints on `loop_rate` has no bound for a law that learns the inertia; `proof: bound` looks for "
        "a law that does not"
    )


def _comments(result: Designed) -> Iterator[tuple[str, str]]:
    """Yield the path of each key with its comment."""
    frame, choice = result.frame, result.choice
    yield "robot", _proof(result)
    yield (
        "scheme.transformation.performance",
        f"The error is within `final` from the deadline on. In the worst of {result.worst.cases} common cases the "
        f"steady error is {result.worst.error:.2g}. `initial` has room for all starts.",
    )
    yield "scheme.surface", "Steeper or flatter surfaces were not better."
    if choice.margin is not None:
        lacks = "" if result.demand is None else f", {result.demand.needed:.3g} N m"
        times = f"{U_AMPLE:g} times" if frame.least_margin is None else f"at least {U_OVER:g} times"
        yield "scheme.bound", f"u: {times} the largest model error{lacks}, (44), (45)."
    else:
        yield "scheme.bound", "The bound follows from the arm, its drives and the mismatch above."
    yield (
        "scheme.sampled_data.horizon",
        f"{choice.horizon / frame.period:.3g} periods: found on common cases, with surface, `overshoot` and estimator.",
    )
    if choice.drift is not None:
        drift = f"The disturbance drifts by {choice.drift * 0.8:.2g} % of the rated torque in a second"
        even = f"; the joints' drifts are evened by {choice.even:.2g} of the way." if choice.even else "."
        yield "scheme.sampled_data.estimator", drift + even
    learning = f"Learning is off: from {JOINTS} joints on no law that learns the inertia has a bound."
    yield "scheme.sampled_data.adaptation", learning
    warning = f"Warns before the envelope is left: 1.25 times the share that {MANY} common cases used."
    yield "scheme.sampled_data.monitor", warning


def _relative(block: dict[str, Any], folder: Path) -> dict[str, Any]:
    block = dict(block)
    if isinstance(block.get("file"), str):
        block["file"] = relpath(block["file"], folder)
    if block.get("packages"):
        block["packages"] = [relpath(package, folder) for package in block["packages"]]
    return block
