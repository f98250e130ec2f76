"""Playgrounds run by node, as a browser runs them."""

import base64
import gzip
import json
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slidax.scenarios.load import validate_text

HERE = Path(__file__).parent
LOOP = Path(__file__).parents[3] / "src/slidax/export/web/page/loop.js"

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


def numbers(text):
    return np.frombuffer(gzip.decompress(base64.b64decode(text)), "<f8").copy()


def unpacked(text):
    return json.loads(gzip.decompress(base64.b64decode(text)))


def variant_of(setting, choices):
    at = [
        choice["values"].index(choices[choice["path"]]) if choice["path"] in choices else choice["default"]
        for choice in setting["choices"]
    ]
    return next(item for item in setting["variants"] if item["at"] == at)


def inputs_of(setting, variant, tunables):
    result = numbers(variant["constants"])
    by_path = {tunable["path"]: tunable["inputs"] for tunable in setting["tunables"]}
    for path, value in tunables.items():
        start, count = by_path[path]
        result[start : start + count] = value
    return result


FLAG = "--experimental-wasm-relaxed-simd"
"""By which older versions of node know multiply-adds."""

ROUNDED = """
const code = new Uint8Array([0,97,115,109,1,0,0,0,1,8,1,96,3,124,124,124,1,124,3,2,1,0,7,5,1,1,102,0,0,10,22,1,20,0,
  32,0,253,20,32,1,253,20,32,2,253,20,253,135,2,253,33,0,11]);
const { f } = new WebAssembly.Instance(new WebAssembly.Module(code)).exports;
process.exit(f(1 + 2 ** -30, 1 + 2 ** -30, -(1 + 2 ** -29)) === 2 ** -60 ? 0 : 1);
"""


@cache
def flags():
    for tried in ((), (FLAG,)):
        if subprocess.run(["node", *tried, "-e", ROUNDED], capture_output=True, timeout=60).returncode == 0:
            return tried
    return None


def rounds_once():
    return flags() is not None


def played(manifest, program, inputs, folder, times=1, *, relaxed=True):
    file = folder / "playground.json"
    file.write_text(json.dumps(manifest))
    command = ["node", "--no-warnings", *(flags() or ()), str(HERE / "run.mjs"), str(LOOP), str(file), program]
    command += [str(times), "" if relaxed else "plain"]
    message = subprocess.run(command, input=json.dumps(inputs.tolist()), capture_output=True, text=True, timeout=120)
    assert message.returncode == 0, message.stderr
    return json.loads(message.stdout)


def scenario_of(setting, changes):
    return validate_text(setting["scenario"], dict(changes)).build("downloaded")
