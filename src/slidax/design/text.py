"""A design as a file: the scenario with its law, each number with its reason."""

from __future__ import annotations

import io
import json
from os.path import relpath
from pathlib import Path
from textwrap import fill
from typing import Any

from ruamel.yaml import YAML

from slidax._writing import write_text
from slidax.certificates import Certificates
from slidax.certificates.loop.jointly import JOINTS
from slidax.certificates.verdict import Verdict

from .design import U_AMPLE, U_OVER, Designed
from .proof import boundable
from .search import MANY

CERTIFICATE = ".certificate.json"
"""Follows the scenario's own name."""


def written(found: Designed, folder: Path) -> str:
    """The scenario as YAML with comments, which runs as it is.

    - `found`: the design.
    - `folder`: where it will be, so that files are named from there.
    """
    data = found.description.model_dump(mode="json", exclude_unset=True)
    scheme = data.pop("scheme")
    time, sets = data.pop("simulation"), data.pop("uncertainty", {})
    data = {
        name: _relative(value, folder) if name in ("robot", "trajectory") else value for name, value in data.items()
    }
    title = data.pop("title")
    blocks = "".join(f"{_yaml({name: value})}\n" for name, value in data.items())
    uncertain = f"{_yaml({'uncertainty': sets})}\n" if sets else ""
    return (
        f"title: {json.dumps(title, ensure_ascii=False)}\n\n{_comment(_proof(found))}\n{blocks}{uncertain}"
        f"scheme:\n  name: {scheme['name']}\n{_law(found, scheme)}\n{_yaml({'simulation': time})}"
    )


def write_design(found: Designed, out: Path, certificates: Certificates) -> Path:
    """Writes the scenario and its certificate beside it, and returns the certificate's path.

    - `found`: the design.
    - `out`: the scenario's path.
    - `certificates`: of the scenario.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, written(found, out.parent))
    beside = out.with_name(out.stem + CERTIFICATE)
    text = json.dumps(certificates.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(beside, text + "\n")
    return beside


def _proof(found: Designed) -> str:
    check = found.check.bound
    said = f"Tested in simulation, not proved: {_unproved(found)}."
    if found.proof == "bound":
        said = f"{called(found.rate)[0].upper()}{called(found.rate)[1:]}; the file beside this one lists its lines."
    if not check:
        return f"{said} Nothing is uncertain, so that one run says all."
    return (
        f"{said} {check['runs']} random cases of the set and {check['searched']} of a search for the worst stay "
        f"inside, the worst with {check['worst_margin']:.2g} of the envelope's width to spare."
    )


def _unproved(found: Designed) -> str:
    if boundable(found.frame.initial.size, found.frame.learns):
        return "`loop_rate` has no bound within such an envelope for this set"
    return (
        f"from {JOINTS} joints on `loop_rate` has no bound for a law that learns the inertia; with `proof: bound` "
        "one is looked for that does not"
    )


def called(rate: Verdict | None) -> str:
    """The word for a law for which `loop_rate` holds: certified if all lines are proved, else tested.

    - `rate`: the certificate's answer.
    """
    if rate is None or rate.grade is None:
        return "tested"
    if rate.grade == "A":
        return "certified by `loop_rate`, grade A: all of its lines are proved"
    return f"tested, with a bound of `loop_rate`, grade {rate.grade}: its lines: {rate.stands_on}"


def _law(found: Designed, scheme: dict[str, Any]) -> str:
    """All that the scheme says, with a comment where there is something to say."""
    envelope = {name: value for name, value in scheme.pop("transformation", {}).items() if name != "kind"}
    sampled, scheme = scheme.pop("sampled_data"), {**envelope, **scheme}
    said = _comments(found)
    lines = [said.get(name, "") + _inside(name, value) for name, value in scheme.items() if name != "name"]
    if "bound" not in scheme:
        lines.append(_comment("`bound` is not given: it follows from the arm, its drives and the mismatch above.", 2))
    lines.append("  sampled_data:\n")
    return "".join(lines + [said.get(name, "") + _inside(name, value, 4) for name, value in sampled.items()])


def _comments(found: Designed) -> dict[str, str]:
    """What is said of a key, above it."""
    frame, choice = found.frame, found.choice
    lacks = "" if found.asked is None else f", {found.asked.needed:.3g} N m"
    times = f"{U_AMPLE:g} times" if frame.least_margin is None else f"at least {U_OVER:g} times"
    said = {
        "performance": f"The error is within `final` from the deadline on. In the worst of {found.worst.cases} common "
        f"cases the steady error is {found.worst.error:.2g}. `initial` has room for all starts.",
        "surface": "Steeper or flatter ones were not better.",
        "bound": f"u: {times} what the model lacks at most{lacks}, (44), (45).",
    }
    inside = {
        "horizon": f"{choice.horizon / frame.period:.3g} periods: found on common cases, with surface, `overshoot` and "
        "estimator.",
        "adaptation": f"The inertia is not learnt: from {JOINTS} joints on no law that learns it has a bound.",
        "monitor": f"Warns before the envelope is left: by what {MANY} common cases used of it, and a quarter more.",
    }
    if choice.drift is not None:
        drift = f"The disturbance drifts by {choice.drift * 0.8:.2g} % of the rated torque in a second"
        drift += f"; by joint this is made more even, {choice.even:.2g} of the way." if choice.even else "."
        inside["estimator"] = drift
    return {name: _comment(text, 2) for name, text in said.items()} | {
        name: _comment(text, 4) for name, text in inside.items()
    }


def _relative(block: dict[str, Any], folder: Path) -> dict[str, Any]:
    found = dict(block)
    if isinstance(found.get("file"), str):
        found["file"] = relpath(found["file"], folder)
    if found.get("packages"):
        found["packages"] = [relpath(one, folder) for one in found["packages"]]
    return found


def _inside(name: str, value: Any, indent: int = 2) -> str:
    flow = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = True
    yaml.width = 10_000
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump({name: value}, flow)
    return f"{' ' * indent}{flow.getvalue().strip()[1:-1]}\n"


def _yaml(value: Any) -> str:
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 118
    text = io.StringIO()
    yaml.dump(value, text)
    return text.getvalue()


def _comment(text: str, indent: int = 0) -> str:
    start = " " * indent + "# "
    return fill(text, 118, initial_indent=start, subsequent_indent=start, break_on_hyphens=False) + "\n"
