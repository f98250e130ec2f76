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
ARGUMENTS = ("parameters", "memory", "measurement", "reference", "envelope")


@dataclass(frozen=True)
class Exported:
    """An exported unit.

    - `variables`: by value reference.
    - `platforms`: of its binaries, as FMI 3.0 names them.
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
    """Write a scenario's law as an FMU to the file `out`: binaries, sources, a description of all variables, a page.

    - `name`: the law's name in C; by default the scenario's.
    - `fmi`: 3 for FMI 3.0, 2 for FMI 2.0.
    - `platforms`: of the binaries, such as `x86_64-linux`; by default all that this machine has a compiler for.
    - `command`: the command line, quoted in the file headers.

    Raises DefinitionError if there is no native code for the law, no compiler, or the file cannot be written.
    """
    if fmi not in VERSIONS:
        raise DefinitionError(f"FMI version must be 3 or 2; got {fmi}")
    if out.suffix != ".fmu":
        raise DefinitionError(f"the name of an FMU must end in .fmu; got `{out}`")
    machines = chosen(platforms)
    exported = project(scenario, name=name, command=command, with_golden=False)
    texts, these, token = _texts(exported, fmi)
    sources = sorted(file for file in texts if file.endswith(".c"))
    inside: dict[str, bytes] = {
        "modelDescription.xml": model_description(exported, these, fmi=fmi, token=token, files=sources).encode(),
        "documentation/index.html": render("fmu/index.html.j2", _page(exported, these, fmi)).encode(),
        **{f"sources/{file}": text.encode() for file, text in texts.items()},
    }
    if fmi == 3:
        inside["sources/buildDescription.xml"] = build_description(exported, sources).encode()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in texts.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        for each in machines:
            binary = f"binaries/{each.folder(fmi)}/{exported.prefix}{each.ending}"
            inside[binary] = library(each, Path(folder), sources, exported.prefix)
    _write(out, inside)
    return Exported(exported, these, [each.name for each in machines])


def _texts(exported: Project, fmi: int) -> tuple[dict[str, str], list[Variable], str]:
    """Sources by name, variables, and the token that ties the description to them."""
    helpers = Helpers(exported.dialect)
    function = envelope_function(exported.guard, exported.step)
    envelope = None if function is None else body(function, exported.dialect, ARGUMENTS, helpers)
    these = variables(exported, with_envelope=envelope is not None)
    law = {
        f"{exported.prefix}.h": render("header.h.j2", {"x": exported}),
        f"{exported.prefix}.c": render("step.c.j2", {"x": exported}),
    }
    digest = hashlib.sha256(repr((sorted(law.items()), these, fmi, exported.version)).encode()).hexdigest()
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, digest)}}}"
    values: dict[str, Any] = {
        "x": exported,
        "variables": these,
        "token": token,
        "envelope": envelope,
        "envelope_members": envelope_members(len(exported.joints)),
        "helpers": helpers.lines,
        "absent": [(each, (SELF, *arguments)) for each, arguments in ABSENT.items()],
        "end": _end,
    }
    files = ("model.h", "model.c", f"fmi{fmi}.h", f"fmi{fmi}.c")
    return law | {file: render(f"fmu/{file}.j2", values) for file in files}, these, token


def _page(exported: Project, these: Sequence[Variable], fmi: int) -> dict[str, Any]:
    groups = {
        "Inputs": [each for each in these if each.causality == "input"],
        "Outputs": [each for each in these if each.causality == "output"],
        "Parameters": [each for each in these if each.causality == "parameter"],
    }
    return {"x": exported, "groups": groups, "fmi": fmi, "range": _range}


def _end(number: float) -> str:
    """One end of a range in C."""
    return repr(number) if math.isfinite(number) else f"{'-' if number < 0 else ''}(double)INFINITY"


def _range(variable: Variable) -> str:
    """Range of a variable, if the unit checks it."""
    if math.isinf(variable.lower) and math.isinf(variable.upper):
        return ""
    if math.isinf(variable.upper):
        return f"{'>' if variable.open[0] else '≥'} {variable.lower:g}"
    if math.isinf(variable.lower):
        return f"{'<' if variable.open[1] else '≤'} {variable.upper:g}"
    before, after = "(" if variable.open[0] else "[", ")" if variable.open[1] else "]"
    return f"{before}{variable.lower:g}, {variable.upper:g}{after}"


def _write(out: Path, inside: dict[str, bytes]) -> None:
    """Write a zip file that is the same for the same contents."""
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
