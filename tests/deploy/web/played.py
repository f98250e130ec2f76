"""Playgrounds run by node, as a browser runs them."""

from __future__ import annotations

import base64
import gzip
import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.scenarios import Scenario
from slidax.scenarios.load import validated

HERE = Path(__file__).parent
LOOP = Path(__file__).parents[3] / "src/slidax/deploy/web/page/loop.js"

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


def numbers(text: str) -> np.ndarray:
    """What is base64 of gzip."""
    return np.frombuffer(gzip.decompress(base64.b64decode(text)), "<f8").copy()


def variant_of(setting: Mapping[str, Any], choices: Mapping[str, Any]) -> Mapping[str, Any]:
    """The variant with these choices, and else the defaults."""
    at = [
        choice["values"].index(choices[choice["path"]]) if choice["path"] in choices else choice["default"]
        for choice in setting["choices"]
    ]
    return next(one for one in setting["variants"] if one["at"] == at)


def inputs_of(setting: Mapping[str, Any], variant: Mapping[str, Any], knobs: Mapping[str, Any]) -> np.ndarray:
    """A program's inputs."""
    found = numbers(variant["constants"])
    by_path = {knob["path"]: knob["inputs"] for knob in setting["knobs"]}
    for path, value in knobs.items():
        start, count = by_path[path]
        found[start : start + count] = value
    return found


def played(manifest: Mapping[str, Any], program: str, inputs: np.ndarray, folder: Path, times: int = 1) -> Any:
    """What loop.js makes of a program."""
    file = folder / "playground.json"
    file.write_text(json.dumps(manifest))
    command = ["node", "--no-warnings", str(HERE / "run.mjs"), str(LOOP), str(file), program, str(times)]
    said = subprocess.run(command, input=json.dumps(inputs.tolist()), capture_output=True, text=True, timeout=120)
    assert said.returncode == 0, said.stderr
    return json.loads(said.stdout)


def scenario_of(setting: Mapping[str, Any], changes: Mapping[str, Any]) -> Scenario:
    """The setting's scenario, as a page gives it to be downloaded."""
    return validated(setting["scenario"], dict(changes)).build("downloaded")
