"""A scenario's law as a Functional Mock-up Unit for co-simulation."""

from __future__ import annotations

import hashlib
import math
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slidax._errors import DefinitionError
from slidax._writing import reason, replacing
from slidax.codegen.c import Helpers

from ..contents import Project
from ..envelope import envelope_function, envelope_members
from ..project import project
from ..source import body
from ..text import render
from .absent import ABSENT, SELF
from .description import build_description, model_description
from .platforms import chosen, library
from .variables import Variable, variables

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

VERSIONS = (3, 2)
ROOM = "slidax.deploy.fmu"
ARGUMENTS = ("parameters", "memory", "measurement", "reference", "envelope")


@dataclass(frozen=True)
class Exported:
    """What was written.

    - `project`: the step inside.
    - `variables`: of the unit, by value reference.
    - `platforms`: that it has binaries for, as FMI 3.0 names them.
    """

    project: Project
    variables: list[Variable]
    platforms: list[str]


def export_fmu(
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    fmi: int = 3,
    platforms: Sequence[str] | None = None,
    command: str = "",
) -> Exported:
    """Writes a scenario's law as an FMU: binaries, sources, a description of all variables, a page.

    - `scenario`: whose law and limits.
    - `out`: the file.
    - `name`: of the law in C; after the scenario if None.
    - `fmi`: 3 for FMI 3.0, 2 for FMI 2.0.
    - `platforms`: to make binaries for, such as `x86_64-linux`; None: all that this machine has a compiler for.
    - `command`: that asked for it, for the headers.

    Raises DefinitionError if there is no native code for the law, no compiler, or the file cannot be written.
    """
    if fmi not in VERSIONS:
        raise DefinitionError(f"there is FMI 3 and 2; got {fmi}")
    if out.suffix != ".fmu":
        raise DefinitionError(f"an FMU is a file whose name ends in .fmu; got `{out}`")
    machines = chosen(platforms)
    made = project(scenario, name=name, command=command, with_golden=False)
    texts, these, token = _texts(made, fmi)
    sources = sorted(file for file in texts if file.endswith(".c"))
    inside: dict[str, bytes] = {
        "modelDescription.xml": model_description(made, these, fmi=fmi, token=token, files=sources).encode(),
        "documentation/index.html": render("index.html.j2", _page(made, these, fmi), ROOM).encode(),
        **{f"sources/{file}": text.encode() for file, text in texts.items()},
    }
    if fmi == 3:
        inside["sources/buildDescription.xml"] = build_description(made, sources).encode()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in texts.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        for each in machines:
            binary = f"binaries/{each.folder(fmi)}/{made.prefix}{each.ending}"
            inside[binary] = library(each, Path(folder), sources, made.prefix)
    _write(out, inside)
    return Exported(made, these, [each.name for each in machines])


def _texts(made: Project, fmi: int) -> tuple[dict[str, str], list[Variable], str]:
    """The sources by name, the variables, and the token that ties the description to them."""
    helpers = Helpers(made.dialect)
    function = envelope_function(made.guard, made.step)
    envelope = None if function is None else body(function, made.dialect, ARGUMENTS, helpers)
    these = variables(made, with_envelope=envelope is not None)
    law = {
        f"{made.prefix}.h": render("header.h.j2", {"x": made}),
        f"{made.prefix}.c": render("step.c.j2", {"x": made}),
    }
    digest = hashlib.sha256(repr((sorted(law.items()), these, fmi, made.version)).encode()).hexdigest()
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, digest)}}}"
    values: dict[str, Any] = {
        "x": made,
        "variables": these,
        "token": token,
        "envelope": envelope,
        "envelope_members": envelope_members(len(made.joints)),
        "helpers": helpers.lines,
        "absent": [(each, (SELF, *arguments)) for each, arguments in ABSENT.items()],
        "end": _end,
    }
    files = ("model.h", "model.c", f"fmi{fmi}.h", f"fmi{fmi}.c")
    return law | {file: render(f"{file}.j2", values, ROOM) for file in files}, these, token


def _page(made: Project, these: Sequence[Variable], fmi: int) -> dict[str, Any]:
    groups = {
        "Inputs": [each for each in these if each.causality == "input"],
        "Outputs": [each for each in these if each.causality == "output"],
        "Parameters": [each for each in these if each.causality == "parameter"],
    }
    return {"x": made, "groups": groups, "fmi": fmi, "range": _range}


def _end(number: float) -> str:
    """One end of a range in C."""
    return repr(number) if math.isfinite(number) else f"{'-' if number < 0 else ''}(double)INFINITY"


def _range(said: Variable) -> str:
    """The range of a variable, as far as the unit checks it."""
    if math.isinf(said.lower) and math.isinf(said.upper):
        return ""
    if math.isinf(said.upper):
        return f"{'>' if said.open[0] else '≥'} {said.lower:g}"
    if math.isinf(said.lower):
        return f"{'<' if said.open[1] else '≤'} {said.upper:g}"
    before, after = "(" if said.open[0] else "[", ")" if said.open[1] else "]"
    return f"{before}{said.lower:g}, {said.upper:g}{after}"


def _write(out: Path, inside: dict[str, bytes]) -> None:
    """A zip file that is the same for the same contents."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with replacing(out) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(inside, key=lambda name: (name != "modelDescription.xml", name)):
                about = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                about.compress_type = zipfile.ZIP_DEFLATED
                about.external_attr = 0o644 << 16
                archive.writestr(about, inside[name])
    except OSError as error:
        raise DefinitionError(f"cannot write `{out}`: {reason(error)}") from None
