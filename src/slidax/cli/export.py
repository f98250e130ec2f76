"""`slidax export ...`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .common import Changes, Named, command_line, errors_as_lines, parse_changes, prepare, say, stage_bar

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

Folder = Annotated[Path, typer.Option(help="Folder of the project.")]

LawName = Annotated[str | None, typer.Option(help="Name of the law in C; default: from the scenario's name.")]

Floats = Annotated[bool, typer.Option("--float", help="Use float instead of double.")]

Quick = Annotated[
    bool,
    typer.Option("--quick", help="Omit tests and golden samples, which take most of the export's time."),
]

Compensation = StrEnum("Compensation", ["law", "robot"])
"""Where gravity is compensated: in the law, or by the robot itself."""


def export_c(
    scenario: Named,
    out: Folder,
    name: LawName = None,
    single: Floats = False,
    quick: Quick = False,
    admission: Annotated[
        bool,
        typer.Option("--admission", help="Add a function that admits or refuses motions, as `slidax admit` does."),
    ] = False,
    changes: Changes = None,
) -> None:
    """Export the law as a C99 project: library, tests against Python, latency benchmark, example, C++ wrapper."""

    def summary(project: Any, parts: Scenario) -> str:
        from slidax.export import measure_step

        if admission:
            from slidax.export.admission import export_admission

            export_admission(parts, project, out)
        size = measure_step(project, out)
        operations = "" if project.longest is None else f" and {project.longest.operations} operations"
        return f"at most {project.stack} bytes of stack{operations} per step, {size}"

    with errors_as_lines():
        out.mkdir(parents=True, exist_ok=True)
    options = {"name": name, "single": single, "golden": not quick}
    _export("c", "slidax.export", scenario, changes, out, summary, **options)


def export_micro(
    scenario: Named, out: Folder, name: LawName = None, single: Floats = False, changes: Changes = None
) -> None:
    """Export the law for Cortex-M and RISC-V: Makefile, start-up code, and a test that runs in emulators."""

    def summary(project: Any, _: Scenario) -> str:
        return f"at most {project.stack} bytes of stack; `make test` in the folder tests it in emulators"

    _export("micro", "slidax.export.micro", scenario, changes, out, summary, name=name, single=single)


def export_franka(
    scenario: Named,
    out: Folder,
    name: LawName = None,
    single: Floats = False,
    quick: Quick = False,
    changes: Changes = None,
) -> None:
    """Export the law for a Franka arm: C++ for libfranka, Python for pylibfranka, and a simulated arm."""
    options = {"name": name, "single": single, "golden": not quick}
    _export("franka", "slidax.export.robots", scenario, changes, out, "for a Franka arm", **options)


def export_ur(
    scenario: Named,
    out: Folder,
    name: LawName = None,
    single: Floats = False,
    quick: Quick = False,
    changes: Changes = None,
) -> None:
    """Export the law for a Universal Robots arm: Python for ur_rtde's directTorque, and a simulated arm."""
    options = {"name": name, "single": single, "golden": not quick}
    _export("ur", "slidax.export.robots", scenario, changes, out, "for a Universal Robots arm", **options)


def export_can(
    scenario: Named,
    out: Folder,
    motors: Annotated[str, typer.Option(help="Motor of each joint, comma-separated, such as DM8009,DM4340,DM4310.")],
    name: LawName = None,
    single: Floats = False,
    quick: Quick = False,
    changes: Changes = None,
) -> None:
    """Export the law as a program for CAN motors with MIT mode (Damiao): Python for python-can, and the frames in C."""
    names = [each.strip() for each in motors.split(",")]
    options = {"motors": names, "name": name, "single": single, "golden": not quick}
    _export("can", "slidax.export.can_motors", scenario, changes, out, "for CAN motors", **options)


def export_ros2(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="Folder of the package.")],
    name: LawName = None,
    single: Floats = False,
    gravity: Annotated[
        Compensation, typer.Option(help="Who compensates gravity: `robot` if the robot does so itself.")
    ] = Compensation.law,
    admission: Annotated[
        bool, typer.Option("--admission", help="Accept only goals inside the law's guarantee, as `slidax admit` does.")
    ] = False,
    quick: Quick = False,
    changes: Changes = None,
) -> None:
    """Export the law as a ROS 2 package: a ros2_control controller for MoveIt, and a node in Python."""
    options = {"name": name, "single": single, "gravity": gravity.value, "golden": not quick, "admission": admission}
    _export("ros2", "slidax.export.ros2", scenario, changes, out, "for ros2_control", **options)


def export_fmu(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The file, NAME.fmu.")],
    name: LawName = None,
    fmi: Annotated[int, typer.Option(help="3 for FMI 3.0, 2 for FMI 2.0.")] = 3,
    platforms: Annotated[
        str | None, typer.Option(help="Platforms, comma-separated, such as x86_64-linux,x86_64-windows; default: all.")
    ] = None,
    changes: Changes = None,
) -> None:
    """Export the law as a Functional Mock-up Unit for co-simulation, with binaries and sources."""
    with _exporting(scenario, changes) as parts:
        from slidax.export import fmu

        chosen = None if platforms is None else [each.strip() for each in platforms.split(",")]
        unit = fmu.export_fmu(parts, out, name=name, fmi=fmi, platforms=chosen, command=command_line())
        say(
            f"{unit.project.law}, FMI {fmi}.0, {len(unit.variables)} variables, a step every "
            f"{unit.project.period_text}, for {', '.join(unit.platforms)}: {out.resolve()}"
        )


def export_web(
    out: Annotated[Path, typer.Option(help="Folder of the page.")],
    scenario: Annotated[
        str | None, typer.Argument(help="A built-in scenario by name, or a YAML file; default: the whole playground.")
    ] = None,
    beside: Annotated[
        str | None,
        typer.Option(
            "--with",
            metavar="A,B,C",
            help="Further schemes; `printed` is the scenario's own scheme as its source prints it.",
        ),
    ] = None,
    changes: Changes = None,
) -> None:
    """Export a page that simulates the closed loop in the browser, with a slider for every parameter.

    The page is one file and needs no server. Without a scenario it has three arms with five laws each.
    """
    with errors_as_lines():
        prepare()
        from slidax.core.errors import DefinitionError, count_noun
        from slidax.export import web
        from slidax.scenarios.load import load

        if scenario is None and (beside or changes):
            raise DefinitionError("`--with` and `--set` need a scenario: name one")
        names = [name.strip() for name in (beside or "").split(",") if name.strip()]
        with stage_bar() as begin:
            if scenario is None:
                manifest = web.manifest_of_all(begin)
            else:
                manifest = web.manifest_of_scenario(load(scenario, parse_changes(changes or [])), names, begin)
        page = web.write_playground(manifest, out)
        sliders = sum(len(setting["tunables"]) for setting in manifest["settings"])
        say(
            f"{count_noun(len(manifest['settings']), 'law')}, {count_noun(len(manifest['programs']), 'program')}, "
            f"{count_noun(sliders, 'slider')}, {page.stat().st_size / 1e6:.2f} MB: {page.resolve()}"
        )


def _export(
    target: str,
    module: str,
    scenario: str,
    changes: list[str] | None,
    out: Path,
    summary: str | Callable[[Any, Scenario], str],
    **options: Any,
) -> None:
    """Export a project by the function `export_TARGET` of a module, and print a summary."""
    with _exporting(scenario, changes) as parts:
        export = getattr(import_module(module), f"export_{target}")
        project = export(parts, out, command=command_line(), **options)
        text = summary if isinstance(summary, str) else summary(project, parts)
        readme = out.resolve() / "README.md"
        place = f"Next: read {readme}" if readme.is_file() else f"The project is in {out.resolve()}"
        say(f"Exported {project.law} in {project.real}s, {text}. {place}")


@contextmanager
def _exporting(scenario: str, changes: list[str] | None) -> Iterator[Scenario]:
    with errors_as_lines():
        prepare()
        from slidax.scenarios.load import load

        yield load(scenario, parse_changes(changes or []))
