"""The command as a user types it, in a process of its own or in this one."""

from __future__ import annotations

import subprocess
import sys

from typer.testing import CliRunner, Result

from slidax.cli import app


def in_process(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def own_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = "from slidax.cli import main; main()"
    return subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)
