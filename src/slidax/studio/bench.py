"""The workbench process: reads, checks and simulates scenarios for the page."""

from __future__ import annotations

import json
import math
import os
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax.analysis.index_sums import INDEX_SUMS
from slidax.analysis.metrics import summary
from slidax.core.errors import DefinitionError, DefinitionWarning

from .files import Folder, require_ending
from .references import YAML, require_beneath, require_file_beneath

MOST_SAMPLES = 2_000_000
"""Largest product of joints and samples in an interactive run; longer runs are jobs."""

MOST_ROWS = 2001
"""Largest number of logged samples in an answer."""

OWN_FAULT = "not computed because of a fault in slidax: please report it"
"""Beginning of the answer to an unexpected exception."""

LARGEST = 1_000_000
"""Largest scenario file [bytes]."""


def main() -> None:
    """Answer requests until standard input ends."""
    import jax
    from platformdirs import user_cache_path

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", str(user_cache_path("slidax") / f"xla-{jax.__version__}"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    # Redirect all other output to standard error, so that standard output has only answers.
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
        self._handlers: dict[str, Callable[[dict[str, Any]], tuple[dict[str, Any], bytes]]] = {
            "check": self._check,
            "run": self._run,
            "manifest": self._manifest,
            "compiled": self._compiled,
            "new": self._new,
            "catalogue": self._catalogue,
            "part": self._part,
        }

    def answer(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return the answer to a request as a mapping, and its binary data, which is often empty.

        The mapping of a failed request has only the key `error`.

        - `request`: fields of the request; `do` is its kind, such as "run".
        """
        with warnings.catch_warnings(record=True) as recorded:
            warnings.simplefilter("always")
            try:
                answer, content = self._handlers[request["do"]](request)
            except DefinitionError as error:
                return {"error": {"where": error.where, "message": error.message}}, b""
            except OSError as error:
                return {"error": {"where": "", "message": f"{error.strerror}: `{error.filename}`"}}, b""
            except (MemoryError, RecursionError) as error:
                return {
                    "error": {"where": "", "message": f"too large to compute on this machine ({type(error).__name__})"}
                }, b""
            except Exception as error:
                # The process stays alive for the next question; the log has the traceback.
                traceback.print_exc()
                return {"error": {"where": "", "message": f"{OWN_FAULT} ({type(error).__name__})"}}, b""
        return answer | {"warnings": _messages(recorded)}, content

    def _check(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.analysis.forecast import forecast

        scenario = self._scenario(request)
        return _about(scenario) | {"beforehand": list(forecast(scenario))}, b""

    def _run(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        scenario = self._scenario(request)
        samples = scenario.t1 / scenario.period
        if samples * scenario.state0.q.size > MOST_SAMPLES:
            raise DefinitionError(
                f"a run of {samples:.3g} samples takes too long here: shorten `simulation.t1`, or start it as a job"
            )
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
        from slidax.scenarios.draft import draft

        robot = str(request["robot"])
        if "/" in robot or "." in robot:
            path = self._folder.resolve(robot)
            require_file_beneath(self._folder, path)
            robot = str(path.relative_to(self._folder.root))
        scenario = draft(robot, float(request.get("rate", 1000.0)), tip=request.get("tip") or None)
        return {"text": scenario.text, "notes": list(scenario.notes)}, b""

    def _catalogue(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.scenarios.catalogue import catalogue

        return {"catalogue": catalogue()}, b""

    def _part(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from slidax.scenarios.catalogue import explain_parameters

        part = explain_parameters(str(request["name"]))
        return {"part": json.loads(json.dumps(part, default=str))}, b""

    def _scenario(self, request: dict[str, Any]) -> Any:
        """Build the scenario of a request: built in by `name`, a file by `path`, or a `text`; apply its `changes`."""
        from slidax.scenarios.load import load, parse
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
        file = self._folder.resolve(path)
        text = request.get("text")
        if text is None:
            text = self._folder.content(file, path, LARGEST).decode("utf-8", "replace")
        data = read_yaml(str(text))
        require_beneath(self._folder, data, file.parent)
        # Relative to the studio's folder, so that the scenario's text has file names relative to it.
        return parse(str(text), changes, folder=file.parent.relative_to(self._folder.root)).build(file.stem)


def _messages(recorded: list[warnings.WarningMessage]) -> list[str]:
    """Return the messages of slidax's own warnings, sorted and without repetitions."""
    return sorted({str(warning.message) for warning in recorded if issubclass(warning.category, DefinitionWarning)})


def _about(scenario: Any) -> dict[str, Any]:
    from slidax.scenarios.yaml_text import as_yaml

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


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario
    from slidax.simulation.run import Run


def result_of(run: Run, scenario: Scenario, milliseconds: float) -> tuple[dict[str, Any], bytes]:
    """Return a run's outcome, metrics and names of signals as a mapping, and the signals as bytes.

    The bytes are 64-bit floats, signal by signal; each signal has a row per logged sample.

    - `run`, `scenario`: a run with a log, and its scenario.
    - `milliseconds`: computing time.
    """
    log, outcome = run.log, run.outcome
    assert log is not None
    signals: dict[str, Any] = {
        "q": log.state.q,
        "dq": log.state.dq,
        "q_d": log.reference.q,
        "e": log.e,
        "tau": log.tau,
    }
    bounds = _bounds(run, scenario)
    if bounds is not None:
        lower, upper = bounds
        inside = np.minimum(log.e - lower, upper - log.e) / (upper - lower)
        signals |= {"lower": lower, "upper": upper, "rho": np.maximum(upper, -lower), "margin": inside.min(axis=1)}
    if run.tally.promise is not None:
        signals["assumption_violated"] = np.asarray(log.signals["margin"]) < 0.0
    arrays = {"t": np.asarray(log.t, float)} | {name: np.asarray(values, float) for name, values in signals.items()}
    rows = len(arrays["t"])
    head = {
        "outcome": {"kind": outcome.kind, "message": outcome.message, "time": outcome.t, "joint": outcome.joint},
        "rows": rows,
        "signals": [{"name": name, "width": values.size // max(rows, 1)} for name, values in arrays.items()],
        "metrics": _finite(_dotted(summary(run, INDEX_SUMS))),
        "milliseconds": milliseconds,
    }
    return head, b"".join(np.ascontiguousarray(values, "<f8").tobytes() for values in arrays.values())


def _bounds(run: Run, scenario: Scenario) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the bounds of the scheme's envelope, or else of the scenario's tolerance band; None without either."""
    log = run.log
    assert log is not None
    if log.envelope is not None:
        return np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
    if scenario.tolerance is None:
        return None
    import jax
    import jax.numpy as jnp

    tolerance = scenario.tolerance
    sides = tolerance.init(jnp.zeros(()), jnp.asarray(log.e[0]))
    bounds = jax.vmap(lambda t: tolerance.envelope(t, sides))(jnp.asarray(log.t))
    return np.asarray(bounds.lower), np.asarray(bounds.upper)


def _dotted(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _dotted(value, f"{before}{name}.")
        elif value is not None:
            flat[f"{before}{name}"] = value if isinstance(value, list) else [value]
    return flat


def _finite(values: dict[str, list[Any]]) -> dict[str, list[float | None]]:
    return {
        name: [None if number is None or not math.isfinite(number) else float(number) for number in entries]
        for name, entries in values.items()
    }
