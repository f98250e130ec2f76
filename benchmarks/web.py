"""The closed loop in WebAssembly compared with `slidax run`: differences, speed and size (docs/browser.md)."""

from __future__ import annotations

import base64
import gzip
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from benchmarks import machine  # noqa: E402
from slidax.export.web.playground import playground  # noqa: E402
from slidax.export.web.settings import settings_of  # noqa: E402
from slidax.scenarios import load  # noqa: E402

ROOT = Path(__file__).parents[1]
LOOP, DRIVER = ROOT / "src/slidax/export/web/page/loop.js", ROOT / "tests/export/web/run.mjs"
TIMES = 5
FLAG = "--experimental-wasm-relaxed-simd"
"""Of node 20; newer ones know multiply-adds without it."""
EXACT = {"sensor.resolution": 0.0, "sensor.velocity": "measured"}
RUNS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("example-4.1-1khz", "two-link, 10 s", {}),
    ("example-4.2-1khz", "SCARA, 20 s", {}),
    ("panda-payload", "Panda, 8 s, encoders", {}),
    ("panda-payload", "Panda, 8 s, exact positions", EXACT),
)


def row(name: str, title: str, changes: dict[str, Any]) -> str:
    """One line of the table.

    - `name`, `changes`: of the scenario.
    - `title`: of the line.
    """
    scenario = load(name, changes)
    manifest = playground(title, settings_of(scenario.description, "arm"), {"arm": "arm"}, promised=False)
    setting, program = manifest["settings"][0], manifest["programs"][0]
    inputs = np.frombuffer(gzip.decompress(base64.b64decode(setting["constants"])), "<f8")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "playground.json"
        file.write_text(json.dumps(manifest), encoding="utf-8")
        command = ["node", "--no-warnings", FLAG, str(DRIVER), str(LOOP), str(file), program["id"], str(TIMES)]
        done = subprocess.run(command, input=json.dumps(inputs.tolist()), capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    runs = [scenario.simulate(log_every=int(inputs[-1]), progress=False) for _ in range(TIMES)]
    log = runs[0].log
    assert log is not None
    differs = []
    for signal, array in (("e", log.e), ("tau", log.tau)):
        known = np.asarray(array)
        other = np.reshape(result["signals"][signal], known.shape)
        differs.append(float(np.max(np.abs(other - known) / np.max(np.abs(known), axis=0))))
    size = len(base64.b64decode(program["wasm"])) / 1e3
    native = min(run.timing.run_s for run in runs if run.timing is not None) * 1e3
    web = min(result["milliseconds"])
    return f"| {title} | {differs[0]:.1g} | {differs[1]:.1g} | {web:.0f} ms | {native:.0f} ms | {size:.0f} kB |"


def main() -> None:
    """Prints the table."""
    machine.well_made_from_the_start()
    print("| run | error differs by | torque by | in node | native | program, gzipped |")
    print("|---|---:|---:|---:|---:|---:|")
    for run in RUNS:
        print(row(*run), flush=True)


if __name__ == "__main__":
    main()
