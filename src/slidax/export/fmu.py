"""A scenario's law as a Functional Mock-up Unit (FMI 2.0 and 3.0) for co-simulation.

Its variables and their units are in `fmu_variables`.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slidax.codegen.c.expressions import Helpers
from slidax.core.errors import DefinitionError
from slidax.core.writing import error_reason, replace_file

from .c_project import CProject, project
from .c_source import function_body
from .c_structures import render
from .fmu_variables import Variable, build_description, model_description, variables
from .programs import envelope_function, envelope_members

SELF = "fmi3Instance instance"
THESE = ("const fmi3ValueReference valueReferences[]", "size_t nValueReferences")
STATES = "size_t nContinuousStates"
SEEDS = (
    "const fmi3ValueReference unknowns[]",
    "size_t nUnknowns",
    "const fmi3ValueReference knowns[]",
    "size_t nKnowns",
    "const fmi3Float64 seed[]",
    "size_t nSeed",
    "fmi3Float64 sensitivity[]",
    "size_t nSensitivity",
)
"""Arguments that several functions of FMI 3.0 have in common, in C."""

ABSENT: dict[str, tuple[str, ...]] = {
    "fmi3EnterEventMode": (),
    "fmi3EnterStepMode": (),
    "fmi3EnterConfigurationMode": (),
    "fmi3ExitConfigurationMode": (),
    "fmi3EvaluateDiscreteStates": (),
    "fmi3EnterContinuousTimeMode": (),
    "fmi3GetDirectionalDerivative": SEEDS,
    "fmi3GetAdjointDerivative": SEEDS,
    "fmi3GetIntervalDecimal": (*THESE, "fmi3Float64 intervals[]", "fmi3IntervalQualifier qualifiers[]"),
    "fmi3GetIntervalFraction": (
        *THESE,
        "fmi3UInt64 counters[]",
        "fmi3UInt64 resolutions[]",
        "fmi3IntervalQualifier qualifiers[]",
    ),
    "fmi3GetShiftDecimal": (*THESE, "fmi3Float64 shifts[]"),
    "fmi3GetShiftFraction": (*THESE, "fmi3UInt64 counters[]", "fmi3UInt64 resolutions[]"),
    "fmi3SetIntervalDecimal": (*THESE, "const fmi3Float64 intervals[]"),
    "fmi3SetIntervalFraction": (*THESE, "const fmi3UInt64 counters[]", "const fmi3UInt64 resolutions[]"),
    "fmi3SetShiftDecimal": (*THESE, "const fmi3Float64 shifts[]"),
    "fmi3SetShiftFraction": (*THESE, "const fmi3UInt64 counters[]", "const fmi3UInt64 resolutions[]"),
    "fmi3UpdateDiscreteStates": (
        "fmi3Boolean *discreteStatesNeedUpdate",
        "fmi3Boolean *terminateSimulation",
        "fmi3Boolean *nominalsOfContinuousStatesChanged",
        "fmi3Boolean *valuesOfContinuousStatesChanged",
        "fmi3Boolean *nextEventTimeDefined",
        "fmi3Float64 *nextEventTime",
    ),
    "fmi3CompletedIntegratorStep": (
        "fmi3Boolean noSetFMUStatePriorToCurrentPoint",
        "fmi3Boolean *enterEventMode",
        "fmi3Boolean *terminateSimulation",
    ),
    "fmi3SetTime": ("fmi3Float64 time",),
    "fmi3SetContinuousStates": ("const fmi3Float64 continuousStates[]", STATES),
    "fmi3GetContinuousStateDerivatives": ("fmi3Float64 derivatives[]", STATES),
    "fmi3GetEventIndicators": ("fmi3Float64 eventIndicators[]", "size_t nEventIndicators"),
    "fmi3GetContinuousStates": ("fmi3Float64 continuousStates[]", STATES),
    "fmi3GetNominalsOfContinuousStates": ("fmi3Float64 nominals[]", STATES),
    "fmi3GetNumberOfEventIndicators": ("size_t *nEventIndicators",),
    "fmi3GetNumberOfContinuousStates": ("size_t *nContinuousStates",),
    "fmi3GetOutputDerivatives": (*THESE, "const fmi3Int32 orders[]", "fmi3Float64 values[]", "size_t nValues"),
    "fmi3ActivateModelPartition": ("fmi3ValueReference clockReference", "fmi3Float64 activationTime"),
}
"""C arguments, after the instance, of the functions of FMI 3.0 that the FMU does not support; by function name."""


OPTIONS = ("-std=c99", "-O2", "-g0", "-fPIC", "-ffp-contract=off", "-fvisibility=hidden", "-shared")
"""Compiler options; without -ffast-math, since the step's result for NaN and infinity is specified."""


@dataclass(frozen=True)
class Platform:
    """A platform, such as 64-bit Linux, for which an FMU can have a binary.

    - `name`, `older`: name of the binary's folder in FMI 3.0, and in FMI 2.0.
    - `ending`: file extension of a shared library.
    - `target`: zig's name of the platform.
    """

    name: str
    older: str
    ending: str
    target: str

    def folder(self, fmi: int) -> str:
        """Return the folder of the platform's binary inside an FMU of FMI 3 or 2."""
        return self.name if fmi == 3 else self.older


# The oldest supported glibc is 2.17, so that the library also loads on old systems.
PLATFORMS = (
    Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
    Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
    Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
    Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos"),
)
NAMES = [each.name for each in PLATFORMS]


def has_zig() -> bool:
    """True if ziglang is installed, which can compile for all platforms."""
    return importlib.util.find_spec("ziglang") is not None


def this_platform() -> str:
    """Return the name of this machine's platform in FMI 3.0."""
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"{machine}-{platform.system().lower()}"


def choose_platforms(names: Sequence[str] | None) -> list[Platform]:
    """Return the platforms to build for.

    - `names`: platform names in FMI 3.0, such as `x86_64-linux`. None selects all platforms if ziglang, the
      cross-compiler, is installed, and else this machine's platform.

    Raises DefinitionError if `names` is empty, a name is unknown, or a platform has no compiler.
    """
    if names is not None and not names:
        raise DefinitionError(f"`platforms` must have at least one name; supported: {', '.join(NAMES)}")
    for name in names or ():
        if name not in NAMES:
            raise DefinitionError(f"no binary can be built for `{name}`; supported: {', '.join(NAMES)}")
    able = NAMES if has_zig() else [name for name in NAMES if name == this_platform() and shutil.which("cc")]
    missing = [name for name in (names if names is not None else able or [this_platform()]) if name not in able]
    if missing:
        raise DefinitionError(f"no compiler for {', '.join(missing)} found: pip install 'slidax[fmu]'")
    return [each for each in PLATFORMS if each.name in (able if names is None else names)]


def build_library(where: Platform, folder: Path, sources: Sequence[str], name: str) -> bytes:
    """Compile and return the binary for one platform.

    - `where`: the platform.
    - `folder`: folder of the sources, to which the compiler also writes.
    - `sources`: names of the C files.
    - `name`: name of the binary without its extension.

    Raises DefinitionError if the compiler fails.
    """
    binary = folder / f"{name}{where.ending}"
    if has_zig():
        command = [sys.executable, "-m", "ziglang", "cc", "-target", where.target, "-fno-sanitize=all", "-s"]
    else:
        command = ["cc"]
    # File names without folders, and local caches: no path of this machine gets into the binary.
    surroundings = os.environ | {"ZIG_LOCAL_CACHE_DIR": str(folder / "cache"), "SOURCE_DATE_EPOCH": "0"}
    done = subprocess.run(
        [*command, *OPTIONS, *sources, "-o", binary.name, *([] if where.ending == ".dll" else ["-lm"])],
        cwd=folder,
        env=surroundings,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        message = (done.stderr.strip().splitlines() or ["no message"])[0]
        raise DefinitionError(f"the compiler for {where.name} failed: {message}")
    return binary.read_bytes()


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

VERSIONS = (3, 2)
ARGUMENTS = ("parameters", "memory", "measurement", "reference", "envelope")
"""Arguments of the C function that computes errors and envelope."""


@dataclass(frozen=True)
class ExportedFmu:
    """An exported FMU.

    - `project`: the exported law.
    - `variables`: its variables; a variable's index is its value reference.
    - `platforms`: platforms of its binaries, by their names in FMI 3.0.
    """

    project: CProject
    variables: list[Variable]
    platforms: list[str]


def export_fmu(
    scenario: Scenario,
    out: str | Path,
    *,
    name: str | None = None,
    fmi: int = 3,
    platforms: Sequence[str] | None = None,
    command: str = "",
) -> ExportedFmu:
    """Write a scenario's law as an FMU to the file `out`: binaries, sources, model description and an HTML page.

    - `name`: the law's name in C; by default the scenario's.
    - `fmi`: 3 for FMI 3.0, 2 for FMI 2.0.
    - `platforms`: target platforms, such as `x86_64-linux`; by default all with a compiler on this machine.
    - `command`: the command line, quoted in the file headers.

    Raises DefinitionError if the law has no native code, an argument is invalid, there is no compiler, or the file
    cannot be written.
    """
    if fmi not in VERSIONS:
        raise DefinitionError(f"FMI version must be 3 or 2; got {fmi}")
    out = Path(out)
    if out.suffix != ".fmu":
        raise DefinitionError(f"the name of an FMU must end in .fmu; got `{out}`")
    machines = choose_platforms(platforms)
    exported = project(scenario, name=name, command=command, with_golden=False)
    texts, listed, token = _texts(exported, fmi)
    sources = sorted(file for file in texts if file.endswith(".c"))
    inside: dict[str, bytes] = {
        "modelDescription.xml": model_description(exported, listed, fmi=fmi, token=token, files=sources).encode(),
        "documentation/index.html": render("fmu/index.html.j2", _page(exported, listed, fmi)).encode(),
        **{f"sources/{file}": text.encode() for file, text in texts.items()},
    }
    if fmi == 3:
        inside["sources/buildDescription.xml"] = build_description(exported, sources).encode()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in texts.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        for each in machines:
            binary = f"binaries/{each.folder(fmi)}/{exported.prefix}{each.ending}"
            inside[binary] = build_library(each, Path(folder), sources, exported.prefix)
    _write(out, inside)
    return ExportedFmu(exported, listed, [each.name for each in machines])


def _texts(exported: CProject, fmi: int) -> tuple[dict[str, str], list[Variable], str]:
    """Return the sources by file name, the variables, and the instantiation token (GUID), a hash of both."""
    helpers = Helpers(exported.dialect)
    function = envelope_function(exported.guard, exported.step)
    envelope = None if function is None else function_body(function, exported.dialect, ARGUMENTS, helpers)
    listed = variables(exported, with_envelope=envelope is not None)
    law = {
        f"{exported.prefix}.h": render("header.h.j2", {"x": exported}),
        f"{exported.prefix}.c": render("step.c.j2", {"x": exported}),
    }
    digest = hashlib.sha256(repr((sorted(law.items()), listed, fmi, exported.version)).encode()).hexdigest()
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, digest)}}}"
    values: dict[str, Any] = {
        "x": exported,
        "variables": listed,
        "token": token,
        "envelope": envelope,
        "envelope_members": envelope_members(len(exported.joints)),
        "helpers": helpers.lines,
        "absent": [(each, (SELF, *arguments)) for each, arguments in ABSENT.items()],
        "end": _end,
    }
    files = ("model.h", "model.c", f"fmi{fmi}.h", f"fmi{fmi}.c")
    return law | {file: render(f"fmu/{file}.j2", values) for file in files}, listed, token


def _page(exported: CProject, listed: Sequence[Variable], fmi: int) -> dict[str, Any]:
    groups = {
        f"{kind.capitalize()}s": [each for each in listed if each.causality == kind]
        for kind in ("input", "output", "parameter")
    }
    return {"x": exported, "groups": groups, "fmi": fmi, "range": _range}


def _end(number: float) -> str:
    """Return the end of a range as a C expression."""
    return repr(number) if math.isfinite(number) else f"{'-' if number < 0 else ''}(double)INFINITY"


def _range(variable: Variable) -> str:
    """Return the range of a variable as text; empty if the variable has no range."""
    if math.isinf(variable.lower) and math.isinf(variable.upper):
        return ""
    if math.isinf(variable.upper):
        return f"{'>' if variable.open[0] else '≥'} {variable.lower:g}"
    if math.isinf(variable.lower):
        return f"{'<' if variable.open[1] else '≤'} {variable.upper:g}"
    before, after = "(" if variable.open[0] else "[", ")" if variable.open[1] else "]"
    return f"{before}{variable.lower:g}, {variable.upper:g}{after}"


def _write(out: Path, inside: dict[str, bytes]) -> None:
    """Write a reproducible zip file: the same contents give the same bytes."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(out) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(inside, key=lambda name: (name != "modelDescription.xml", name)):
                about = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                about.compress_type = zipfile.ZIP_DEFLATED
                about.external_attr = 0o644 << 16
                archive.writestr(about, inside[name])
    except OSError as error:
        raise DefinitionError(f"cannot write `{out}`: {error_reason(error)}") from None
