"""All commands. Everything heavy is imported inside the commands, so that `--help` answers at once."""

from __future__ import annotations

import atexit
import gc
import io
import sys
from typing import Annotated

import typer

from .arm import excite, identify, new
from .catalogue import list_, schema, studio
from .demo import demo, reproduce
from .export import (
    export_c,
    export_can,
    export_fmu,
    export_franka,
    export_micro,
    export_ros2,
    export_ur,
    export_web,
)
from .law import admit, certify, design, linear
from .run import compare, explain, loop, replay, run
from .study import benchmark, study

app = typer.Typer(
    name="slidax",
    help="Sliding-mode control of robot arms inside a prescribed error envelope.",
    epilog="Start with:  slidax run example-4.1",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
export = typer.Typer(
    help="Export a control law as code for a robot.", no_args_is_help=True, rich_markup_mode="markdown"
)
app.add_typer(export, name="export")

app.command(epilog="Example:  slidax demo --open")(demo)
app.command(epilog="Example:  slidax reproduce --out reproduction")(reproduce)
app.command(epilog="Example:  slidax run example-4.1 --set disturbance.scale=0 --set scheme.surface.k1=0.4")(run)
app.command(epilog="Example:  slidax new --robot my-arm.urdf --rate 500 --out my-arm.yaml")(new)
app.command(epilog="Example:  slidax certify example-4.2 --set scheme.bound.margin=2 --out certificate")(certify)
app.command(epilog="Example:  slidax admit pick.csv place.json --scenario my-law.yaml")(admit)
app.command(epilog="Example:  slidax design requirements.yaml --out my-arm.yaml")(design)
app.command(epilog="Example:  slidax compare example-4.1 --schemes cftsmppc,ftsmc,sfsmc --out comparison")(compare)
app.command(epilog="Example:  slidax excite panda --seed 1 --out motion.csv")(excite)
app.command(epilog="Example:  slidax identify log.csv --robot panda --out arm.yaml --report report")(identify)
app.command(epilog="Example:  slidax explain bad  (after  slidax run SCENARIO --out bad)")(explain)
app.command(epilog="Example:  slidax study cases.yaml --out cases  (docs/studies.md has such files)")(study)
app.command(epilog="Example:  slidax benchmark --tasks scara-slow --schemes cftsmppc,pid --out benchmark")(benchmark)
app.command(epilog="Example:  slidax linear example-4.1-1khz --at 5 --out linear")(linear)
app.command(epilog="Example:  slidax loop panda-payload --time 60 --out log.mcap --histogram latency.svg")(loop)
app.command(epilog="Example:  slidax replay log.mcap  (after  slidax run panda-payload --out log.mcap)")(replay)
app.command(epilog="Example:  slidax studio my-arm.yaml  (then drag a slider)")(studio)
app.command("list", epilog="Example:  slidax list scenarios")(list_)
app.command(epilog="Example:  slidax schema > scenario.schema.json")(schema)
export.command("c", epilog="Example:  slidax export c example-4.1-1khz --out law")(export_c)
export.command("fmu", epilog="Example:  slidax export fmu example-4.1-1khz --out law.fmu")(export_fmu)
export.command("micro", epilog="Example:  slidax export micro example-4.1-1khz --float --out law")(export_micro)
export.command("franka", epilog="Example:  slidax export franka panda-payload --out franka")(export_franka)
export.command("can", epilog="Example:  slidax export can my-arm.yaml --motors DM8009,DM4340,DM4310 --out can")(
    export_can
)
export.command("ur", epilog="Example:  slidax export ur ur5e-payload --out ur")(export_ur)
export.command("ros2", epilog="Example:  slidax export ros2 panda-payload --gravity robot --out ros2")(export_ros2)
export.command("web", epilog="Example:  slidax export web panda-payload --with printed --out site")(export_web)


@app.callback(invoke_without_command=True)
def _top(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    allow_code: Annotated[
        bool, typer.Option("--allow-code", help="Import classes of your own that a file names as `module:Class`.")
    ] = False,
) -> None:
    if allow_code:
        from slidax.scenarios.own_code import allow_code as allow

        allow()
    if version:
        import slidax

        typer.echo(f"slidax {slidax.__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point of the `slidax` command."""
    # Most objects live to the end; collecting garbage among them takes a quarter of a short command's time.
    gc.set_threshold(100_000, 50, 50)
    atexit.register(gc.freeze)
    for stream in (sys.stdout, sys.stderr):
        # A character that a terminal or pipe lacks, as on Windows, becomes a question mark instead of an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
