"""The command line as a user types it, in its own process or in this process."""

import json
import subprocess
import sys

from typer.testing import CliRunner

from slidax.cli import app

STUDY = """
study: monte_carlo
scenario: example-4.1-1khz
changes: {simulation.t1: 0.05}
uncertainty: {disturbance.scale: {between: [0, 1]}}
"""
"""A short study without its number of runs."""


def in_process(*arguments, code=None):
    """Run the command; check its exit code unless `code` is None."""
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert code in (None, result.exit_code), result.output
    return result


def answer_of(*arguments, code=0):
    """Run the command with --json; check its exit code and return its answer."""
    return json.loads(in_process(*arguments, "--json", code=code).stdout)


def own_process(*arguments):
    program = "from slidax.cli import main; main()"
    return subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)


def assert_one_line(words, *arguments):
    """Check that a command ends with exit code 2 and a single line with all words; return the line."""
    result = in_process(*arguments, code=2)
    line = result.stderr.strip()
    assert result.stdout == "", result.output
    assert line.startswith("slidax: ") and len(line.splitlines()) == 1 and len(line) < 1500, line
    assert all(word in line for word in words), line
    return line
