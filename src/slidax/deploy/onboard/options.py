"""Command-line options of all robot programs, and real-time priority.

This module runs by itself next to an exported law.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
from pathlib import Path

from .law import Law, Pilot


def loaded(parser: argparse.ArgumentParser, folder: Path) -> Law:
    """Load the law of a folder, compiled if necessary; end the program with one line if that fails."""
    try:
        return Law(folder)
    except FileNotFoundError as error:
        missing = "a C compiler (install gcc, or set CC)" if error.filename in _compiler() else str(error.filename)
        parser.error(f"missing: {missing}")
    except (OSError, subprocess.CalledProcessError) as error:
        parser.error(f"the law in {folder} does not compile or load: {error}")


def _compiler() -> list[str]:
    return os.environ.get("CC", "cc").split()


def prepare(arguments: argparse.Namespace, pilot: Pilot) -> None:
    """Copy options of the command line to the pilot."""
    path = pilot.options.path
    for name in ("hold", "speed", "amplitude", "small", "widen", "motion"):
        value = getattr(arguments, name)
        if value is not None:
            setattr(path, name, value)
    for name in ("error_hold", "error_small", "error_full"):
        value = getattr(arguments, name)
        if value is not None:
            getattr(pilot.options, name)[:] = [value] * pilot.law.joints


def options_of_the_path(parser: argparse.ArgumentParser) -> None:
    """Add the options of the first motion."""
    for name, unit, meaning in (
        ("hold", "S", "how long the measured posture is held"),
        ("speed", "RAD/S", "of the fastest joint on the way to the motion's beginning"),
        ("amplitude", "SHARE", "of the motion while it is small"),
        ("small", "S", "how long it is small"),
        ("widen", "S", "in which it widens to the whole"),
        ("motion", "S", "how long the whole motion lasts"),
        ("error-hold", "RAD", "largest error while it holds"),
        ("error-small", "RAD", "largest error while the motion is small"),
        ("error-full", "RAD", "largest error later"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar=unit, help=f"{meaning}; the exported one if not given")
    parser.add_argument("--log", type=Path, help="write what happened as CSV")


def robot_parser(description: str | None, folder: Path) -> argparse.ArgumentParser:
    """Return a parser with the options of all programs that control a robot.

    - `folder`: of the program, with the law in its folder `law`.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address", help="of the robot")
    parser.add_argument("--law", type=Path, default=folder / "law", help="the folder of the law")
    load = ("KG", "X", "Y", "Z")
    parser.add_argument("--load", type=float, nargs=4, metavar=load, help="told to the robot: mass and place")
    parser.add_argument("--no-realtime", action="store_true", help="go on without a real-time priority")
    options_of_the_path(parser)
    return parser


def in_time(enforce: bool) -> None:
    """Request real-time priority.

    Raises OSError if the system refuses it and `enforce` is set.
    """
    gc.collect()
    gc.disable()
    try:
        if sys.platform != "linux":
            raise OSError("real-time priority is available on Linux only")
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))
    except OSError:
        if enforce:
            raise
