"""Variables of an FMU: names, units, ranges, and modelDescription.xml."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from slidax.core.parameter import Parameter

from .c_project import CProject
from .c_structures import Member, declared_arrays
from .programs import envelope_members
from .status import HELD, Condition

BASE: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Hz": {"s": -1},
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "K": {"K": 1},
}
"""Exponents of the SI base units, and of rad, in each unit symbol."""

SUPERSCRIPTS = str.maketrans("²³", "23")
TOKEN = re.compile(r"\s*([()/]|[A-Za-z1]+|\^?\d)\s*")
COUNTS = ("periods", "samples", "sampling periods")
"""Units of counts, which are pure numbers in FMI."""


@dataclass(frozen=True)
class Unit:
    """A physical unit as FMI declares it.

    - `name`: name in FMI, with a dot for a product and plain exponents, such as `N.m` and `kg.m2`.
    - `base`: exponents of the SI base units and of `rad`, in the order in which they appear in the unit.
    """

    name: str
    base: tuple[tuple[str, int], ...]


def parse_unit(declared: str, *, revolute: bool | None = True) -> Unit | None:
    """Parse a declared unit, such as `kg m²` or `rad/s or m/s`; return None for a pure number, a count, or no unit.

    Also None for a unit with a symbol that is not in `BASE`, as a law of one's own may declare it.

    - `revolute`: True if the number belongs to a revolute joint; None if joints of both kinds share it.
    """
    text = declared.strip()
    if not text or text == "1" or text in COUNTS or "," in text:
        return None
    kinds = text.split(" or ")
    if len(kinds) == 2:
        if revolute is None:
            return None
        text = kinds[0 if revolute else 1]
    plain = text.translate(SUPERSCRIPTS).replace("^2", "2").replace("^3", "3")
    tokens = TOKEN.findall(plain)
    if "".join(tokens) != plain.replace(" ", ""):
        return None
    try:
        base = _product(tokens)
    except KeyError:
        return None
    return Unit(re.sub(r"\s+", ".", plain), tuple((name, power) for name, power in base.items() if power))


def _product(tokens: list[str]) -> dict[str, int]:
    """Return the exponents of the base units in a product of units.

    - `tokens`: parts of the text. Those of the product are removed, up to its closing parenthesis if there is one.
    """
    exponents: dict[str, int] = {}
    divided = False
    while tokens:
        token = tokens.pop(0)
        if token == ")":
            break
        if token == "/":
            divided = True
            continue
        factor = _product(tokens) if token == "(" else dict(BASE[token])
        power = int(tokens.pop(0).lstrip("^")) if tokens and tokens[0].lstrip("^") in ("2", "3") else 1
        for name, exponent in factor.items():
            exponents[name] = exponents.get(name, 0) + power * exponent * (-1 if divided else 1)
        divided = False
    return exponents


NO_LIMIT = 1e300
"""Number that stands for infinity, which some importers cannot read; the step treats larger values as infinite."""

UNDECLARED = {"period": "s", "horizon": "s"}
"""Units of parameters that have no declaration."""

SIGNALS = {
    "s": ("sliding variable", "rad/s or m/s"),
    "s_next": ("sliding variable planned for the end of the horizon", "rad/s or m/s"),
    "eps1": ("transformed error", ""),
    "eps2": ("rate of the transformed error", "1/s"),
    "rho": ("radius of the envelope as prescribed", "rad or m"),
    "u": ("magnitude of the robust torque", ""),
    "margin": ("remaining margin of the guarantee; below 0 where it is void", ""),
    "disturbance": ("estimated acceleration that the nominal model does not explain", "rad/s² or m/s²"),
    "residual": ("acceleration error of the last plan", "rad/s² or m/s²"),
    "rotor": ("learned rotor inertia", "kg m² or kg"),
    "coulomb": ("learned Coulomb friction", "N m or N"),
    "rejected": ("1 for a measurement that the gate rejected", ""),
    "envelope_reset": ("1 where the envelope in force is wider than prescribed", ""),
    "assumption_violated": ("1 where the monitor reports a violated assumption of the guarantee", ""),
    "e": ("error of position", "rad or m"),
    "de": ("error of velocity", "rad/s or m/s"),
}
"""Meaning and unit of each signal of a law, by name."""

UNIT_SUFFIX = re.compile(r" \[[^]]*\](?=;|$)")
PLAIN = {"eps1": ("error", "rad or m"), "eps2": ("rate of the error", "rad/s or m/s")}
"""Meanings of the signals `eps1` and `eps2` for a law without an error transformation."""

RATES = {"q": "", "dq": "/s", "ddq": "/s²"}


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU.

    - `name`: structured name, such as `reference.dq_next[2]`.
    - `kind`: "real", "integer" or "boolean".
    - `causality`: "parameter", "input", "output" or "independent".
    - `expression`: C expression of its value, as a member of the instance.
    - `lower`, `upper`: ends of its range; infinite where there is none.
    - `open`: (True if the value `lower` is excluded, True if the value `upper` is excluded).
    """

    name: str
    kind: str
    causality: str
    expression: str
    description: str
    unit: Unit | None = None
    start: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    open: tuple[bool, bool] = (False, False)


def variables(exported: CProject, *, with_envelope: bool) -> list[Variable]:
    """Return the variables of a law's FMU; the index in the list is the value reference.

    - `with_envelope`: True for a law with an envelope, whose errors, bounds and margins become outputs.
    """
    revolute = [joint.q == "rad" for joint in exported.joints]
    second = parse_unit("s")
    listed = [Variable("time", "real", "independent", "now", "time of the importer", second)]
    for structure, members in (("measurement", exported.measurement[1:]), ("reference", exported.reference)):
        for member in members:
            words = f"rad{RATES[member.name.removesuffix('_next')]} or m{RATES[member.name.removesuffix('_next')]}"
            listed += _numbers(structure, member, "input", words, revolute, member.meaning)
    listed.append(
        Variable("restart", "boolean", "input", "restart", "true at a sample: the law is reset and starts again")
    )
    for member in exported.outputs:
        if member.name == "tau":
            listed += _numbers(
                "command", member, "output", "N m or N", revolute, "torque to hold until the next sample"
            )
        else:
            known = SIGNALS if with_envelope else SIGNALS | PLAIN
            meaning, words = known.get(member.name, ("signal of the law", ""))
            listed += _numbers("command", member, "output", words, revolute, meaning)
    if with_envelope:
        for member in envelope_members(len(revolute)):
            words = "" if member.name == "margin" else "rad or m"
            listed += _numbers("envelope", member, "output", words, revolute, member.meaning)
    listed.append(Variable("command.status", "integer", "output", "status", "bits of the status; 0 if all is well"))
    listed += [_flag(condition) for condition in exported.conditions]
    listed.append(Variable("status.held", "boolean", "output", f"bits[{len(exported.conditions)}]",
                          f"true if the torque is the last safe one: any bit of {HELD}"))  # fmt: skip
    for member, (_, parameter, _) in zip(exported.parameters, declared_arrays(exported.guard), strict=True):
        listed += _parameters(member, parameter or Parameter("", ""), revolute)
    return listed


def _flag(condition: Condition) -> Variable:
    expression = f"bits[{condition.bit.bit_length() - 1}]"
    text = f"{condition.meaning.replace('`', '')}. {condition.remedy.replace('`', '')}"
    return Variable(f"status.{condition.name.lower()}", "boolean", "output", expression, text)


def _parameters(member: Member, parameter: Parameter, revolute: list[bool]) -> Iterator[Variable]:
    assert member.values is not None
    lower, upper = parameter.range.ends
    ends = [end.number if end.number is not None and math.isfinite(end.number) else None for end in (lower, upper)]
    kind = {"f64": "real", "b1": "boolean"}.get(member.type, "integer")
    words = parameter.unit or UNDECLARED.get(member.name, "")
    endless = "; 1e300 for no limit" if upper.number == math.inf and not upper.open else ""
    meaning = f"{member.meaning}{endless}".replace("infinite for no limit; 1e300", "1e300")
    for k, variable in enumerate(_numbers("parameters", member, "parameter", words, revolute, meaning)):
        yield replace(
            variable,
            kind=kind,
            start=float(np.clip(member.values.ravel()[k], -NO_LIMIT, NO_LIMIT)),
            lower=-math.inf if ends[0] is None else ends[0],
            upper=math.inf if ends[1] is None else ends[1],
            open=(lower.open, upper.open),
        )


def _numbers(
    structure: str, member: Member, causality: str, words: str, revolute: list[bool], meaning: str
) -> Iterator[Variable]:
    """Yield a variable for each number of a member; indices count from 1, as usual in FMI."""
    for k, index in enumerate(np.ndindex(member.shape)):
        label = f"[{','.join(str(i + 1) for i in index)}]" if member.shape else ""
        # A per-joint value has its joint's unit, any other value the unit shared by all joints.
        of_joint = member.shape[-1:] == (len(revolute),) and len(member.shape) == 1
        kind = revolute[index[-1]] if of_joint else (revolute[0] if len(set(revolute)) == 1 else None)
        yield Variable(
            f"{structure}.{member.name}{label}",
            "real",
            causality,
            f"{structure}.{member.element(k)}",
            UNIT_SUFFIX.sub("", meaning),
            parse_unit(words, revolute=kind),
        )


TYPES = {3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
         2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"}}  # fmt: skip
SHORT = 1000
"""Most sample periods in the default experiment."""

STATES = {
    3: {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"},
    2: {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"},
}


def model_description(
    exported: CProject, listed: Sequence[Variable], *, fmi: int, token: str, files: Sequence[str]
) -> str:
    """Return the text of modelDescription.xml.

    - `listed`: the variables; a variable's index is its value reference.
    - `fmi`: 3 or 2.
    - `token`: instantiation token (GUID), which the binary compares with its own.
    - `files`: names of the C sources in the FMU.
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
    _units(root, listed)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="why a call was refused")
    # Some importers enlarge the step of a run that would take more steps than this.
    end = min(exported.t1, SHORT * exported.period)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime=repr(end), stepSize=repr(exported.period))
    variables = SubElement(root, "ModelVariables")
    # FMI 2.0 needs no variable for the time, and some importers reject it.
    numbered = [(k, each) for k, each in enumerate(listed) if fmi == 3 or each.causality != "independent"]
    for reference, variable in numbered:
        _variable(variables, variable, reference, fmi)
    structure = SubElement(root, "ModelStructure")
    group = structure if fmi == 3 else SubElement(structure, "Outputs")
    for index, (reference, variable) in enumerate(numbered, 1):
        if variable.causality == "output":
            # Outputs change only in a step: none depends on an input at the same instant.
            which = {"valueReference": str(reference)} if fmi == 3 else {"index": str(index)}
            SubElement(group, "Output" if fmi == 3 else "Unknown", which, dependencies="")
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def build_description(exported: CProject, files: Sequence[str]) -> str:
    """Return the text of sources/buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    how = SubElement(root, "BuildConfiguration", modelIdentifier=exported.prefix)
    sources = SubElement(how, "SourceFileSet", language="C99", compilerOptions="-O2 -ffp-contract=off")
    for file in files:
        SubElement(sources, "SourceFile", name=file)
    SubElement(how, "Library", name="m")
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _units(root: Element, listed: Sequence[Variable]) -> None:
    group = SubElement(root, "UnitDefinitions")
    for unit in sorted({each.unit for each in listed if each.unit is not None}, key=lambda unit: unit.name):
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
