"""The file modelDescription.xml of an FMU, in FMI 3.0 and 2.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ..contents import Project
from .variables import Variable

TYPES = {3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
         2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"}}  # fmt: skip
SHORT = 1000
"""Periods of the default experiment."""

STATES = {
    3: {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"},
    2: {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"},
}


def model_description(
    exported: Project, these: Sequence[Variable], *, fmi: int, token: str, files: Sequence[str]
) -> str:
    """The text of modelDescription.xml.

    - `these`: variables by value reference.
    - `fmi`: 3 or 2.
    - `token`: by which the binary recognises its own description.
    - `files`: names of the C sources inside.
    """
    about = {
        "fmiVersion": "3.0" if fmi == 3 else "2.0",
        "modelName": f"slidax.{exported.name}",
        "instantiationToken" if fmi == 3 else "guid": token,
        "description": f"{exported.law}: {exported.title}",
        "generationTool": f"slidax {exported.version}",
        "variableNamingConvention": "structured",
    }
    root = Element("fmiModelDescription", about)
    able = {"modelIdentifier": exported.prefix, "canHandleVariableCommunicationStepSize": "false"} | STATES[fmi]
    step = SubElement(root, "CoSimulation", able)
    if fmi == 3:
        step.set("fixedInternalStepSize", repr(exported.period))
        step.set("providesDirectionalDerivatives", "false")
    else:
        step.set("canNotUseMemoryManagementFunctions", "true")
        sources = SubElement(step, "SourceFiles")
        for file in files:
            SubElement(sources, "File", name=file)
    _units(root, these)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="why a call was refused")
    # Some importers take larger steps than they are told where a run has more of them than this.
    end = min(exported.t1, SHORT * exported.period)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime=repr(end), stepSize=repr(exported.period))
    variables = SubElement(root, "ModelVariables")
    # FMI 2.0 needs no variable for the time, and importers stumble over one.
    listed = [(k, each) for k, each in enumerate(these) if fmi == 3 or each.causality != "independent"]
    for reference, variable in listed:
        _variable(variables, variable, reference, fmi)
    structure = SubElement(root, "ModelStructure")
    group = structure if fmi == 3 else SubElement(structure, "Outputs")
    for place, (reference, variable) in enumerate(listed):
        if variable.causality == "output":
            # Outputs change by a step alone: no input reaches one at the same instant.
            which = {"valueReference": str(reference)} if fmi == 3 else {"index": str(place + 1)}
            SubElement(group, "Output" if fmi == 3 else "Unknown", which, dependencies="")
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def build_description(exported: Project, files: Sequence[str]) -> str:
    """The text of sources/buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    how = SubElement(root, "BuildConfiguration", modelIdentifier=exported.prefix)
    sources = SubElement(how, "SourceFileSet", language="C99", compilerOptions="-O2 -ffp-contract=off")
    for file in files:
        SubElement(sources, "SourceFile", name=file)
    SubElement(how, "Library", name="m")
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _units(root: Element, these: Sequence[Variable]) -> None:
    group = SubElement(root, "UnitDefinitions")
    for unit in sorted({each.unit for each in these if each.unit is not None}, key=lambda unit: unit.name):
        SubElement(SubElement(group, "Unit", name=unit.name), "BaseUnit", {name: str(k) for name, k in unit.base})


def _variable(group: Element, variable: Variable, reference: int, fmi: int) -> None:
    kind = TYPES[fmi][variable.kind]
    variability = {"parameter": "tunable", "independent": "continuous"}.get(variable.causality, "discrete")
    shared = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variability,
    }
    numbers: dict[str, str] = {}
    if variable.causality != "independent":
        numbers["start"] = _written(variable)
        if variable.causality in ("output", "parameter"):
            shared["initial"] = "exact"
    if variable.unit is not None:
        numbers["unit"] = variable.unit.name
    for name, end in (("min", variable.lower), ("max", variable.upper)):
        if math.isfinite(end):
            numbers[name] = repr(end) if variable.kind == "real" else str(int(end))
    if fmi == 3:
        SubElement(group, kind, shared | numbers)
    else:
        SubElement(SubElement(group, "ScalarVariable", shared), kind, numbers)


def _written(variable: Variable) -> str:
    if variable.kind == "boolean":
        return "true" if variable.start else "false"
    return repr(float(variable.start)) if variable.kind == "real" else str(int(variable.start))
