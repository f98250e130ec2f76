"""The workbench process: reads, checks and simulates scenarios for the page, and stays warm.

A request is a line of JSON on standard input. An answer is a line of JSON on standard output, followed by as many
bytes as its field `bytes` says.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, DefinitionWarning

from .folder import Folder
from .names import require_ending
from .references import YAML, require_beneath, require_file_beneath

MOST_SAMPLES = 2_000_000
"""Joints times samples of an interactive run at most; longer runs are jobs."""

MOST_ROWS = 2001
"""Rows of a signal in an answer."""

OWN_FAULT = "not computed because of a fault of slidax: please report it"
"""Beginning of the answer to an unexpected exception."""

LARGEST = 1_000_000
"""Size of a scenario file [bytes]."""


def main() -> None:
    """Answer requests until standard input ends."""
    import jax
    from platformdirs import user_cache_path

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", str(user_cache_path("slidax") / f"xla-{jax.__version__}"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    # Whatever else is printed goes where errors go, so that answers are answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    bench, requests = Bench(Folder(Path.cwd())), _lines()
    while True:
        answer, content = bench.answer(json.loads(requests.get()))
        answers.write(json.dumps(answer | {"bytes": len(content)}).encode() + b"\n" + content)
        answers.flush()


def _lines() -> SimpleQueue[str]:
    """Queue of requests; the process ends when standard input does."""
    requests: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            requests.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    return requests


class Bench:
    """Answers questions about scenarios in a `folder`."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._able: dict[str, Callable[[dict[str, Any]], tuple[dict[str, Any], bytes]]] = {
            "check": self._check,
            "run": self._run,
            "manifest": self._manifest,
            "compiled": self._compiled,
            "new": self._new,
            "catalogue": self._catalogue,
            "part": self._part,
        }

    def answer(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return the answer to a `request`, or an error, and bytes; its field `do` selects the question."""
        with warnings.catch_warnings(record=True) as recorded:
            warnings.simplefilter("always")
            try:
                answer, content = self._able[request["do"]](request)
            except DefinitionError as error:
                return {"error": {"where": error.where, "message": error.message}}, b""
            except OSError as error:
                return {"error": {"where": "", "message": f"{error.strerror}: `{error.filename}`"}}, b""
            except (MemoryError, RecursionError) as error:
                return {
                    "error": {"where": "", "message": f"too large to compute on this machine ({type(error).__name__})"}
                }, b""
            except Exception as error:
                # The process stays for the next question; the log has where it was.
                traceback.print_exc()
                return {"error": {"where": "", "message": f"{OWN_FAULT} ({type(error).__name__})"}}, b""
        return answer | {"warnings": _messages(recorded)}, content

    def _check(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.diagnosis import beforehand

        scenario = self._scenario(request)
        return _about(scenario) | {"beforehand": list(beforehand(scenario))}, b""

    def _run(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from .result import result_of

        scenario = self._scenario(request)
        samples = scenario.t1 / scenario.period
        if samples * scenario.state0.q.size > MOST_SAMPLES:
            raise DefinitionError(f"{samples:.3g} samples take too long here: shorten `simulation.t1`, or use a job")
        every = max(1, int(np.ceil(samples / (MOST_ROWS - 1))))
        started = time.perf_counter()
        run = scenario.simulate(log_every=every)
        return result_of(run, scenario, 1e3 * (time.perf_counter() - started))

    def _manifest(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from .manifest import manifest_of

        scenario = self._scenario(request)
        return {"manifest": manifest_of(scenario)} | _about(scenario), b""

    def _compiled(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from .manifest import compiled_manifest_of

        return {"manifest": compiled_manifest_of(self._scenario(request))}, b""

    def _new(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.commissioning import draft

        robot = str(request["robot"])
        if "/" in robot or "." in robot:
            place = self._folder.place(robot)
            require_file_beneath(self._folder, place)
            robot = str(place.relative_to(self._folder.root))
        scenario = draft(robot, float(request.get("rate", 1000.0)), tip=request.get("tip") or None)
        return {"text": scenario.text, "notes": list(scenario.notes)}, b""

    def _catalogue(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.scenarios import catalogue

        return {"catalogue": catalogue()}, b""

    def _part(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.scenarios import explained

        part = explained(str(request["name"]))
        return {"part": json.loads(json.dumps(part, default=str))}, b""

    def _scenario(self, request: dict[str, Any]) -> Any:
        """A built-in scenario by `name`, a file by `path`, or a `text` in its place; with `changes` by path."""
        from slidax.scenarios import load
        from slidax.scenarios.load import parse
        from slidax.scenarios.yaml_text import read_yaml

        changes = dict(request.get("changes") or {})
        require_beneath(self._folder, changes, self._folder.root)
        if request.get("name"):
            name = str(request["name"])
            if "/" in name or "." in name.removeprefix("example-4."):
                raise DefinitionError("`name` must be a built-in scenario: use `path` for a file")
            return load(name, changes)
        path = str(request.get("path") or "scenario.yaml")
        require_ending(path, YAML)
        place = self._folder.place(path)
        text = request.get("text")
        if text is None:
            text = self._folder.content(place, path, LARGEST).decode("utf-8", "replace")
        data = read_yaml(str(text))
        require_beneath(self._folder, data, place.parent)
        # From the folder, so that what is written of it names files from there, too.
        return parse(str(text), changes, folder=place.parent.relative_to(self._folder.root)).build(place.stem)


def _messages(recorded: list[warnings.WarningMessage]) -> list[str]:
    """Warnings that concern the user."""
    return sorted({str(warning.message) for warning in recorded if issubclass(warning.category, DefinitionWarning)})


def _about(scenario: Any) -> dict[str, Any]:
    from slidax.scenarios.written import as_yaml

    return {
        "scenario": scenario.name,
        "title": scenario.description.title,
        "robot": scenario.robot,
        "scheme": scenario.scheme,
        "joints": scenario.state0.q.size,
        "period": scenario.period,
        "t1": scenario.t1,
        "text": as_yaml(scenario.description),
    }
