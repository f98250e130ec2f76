"""A playground in the page's format, made of a run of ours: its programs only play back what was logged."""

import base64
import gzip
import json
from pathlib import Path

import numpy as np

import slidax as sx
from slidax.export.web.playground import arm_entry

FAKE_LOOP = (Path(__file__).parent / "fake_loop.js").read_text(encoding="utf-8")
ARM, RIVAL = "two-link", "computed_torque"


def packed(data):
    return base64.b64encode(gzip.compress(data, mtime=0)).decode()


def doubles(*arrays):
    return packed(b"".join(np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays))


def fake_playground():
    """With the scheme of the scenario, its printed form (here: three times its error), and a rival (1.5 times)."""
    scenario = sx.scenarios.load("example-4.1-1khz")
    log = scenario.simulate().log
    n, warning = log.e.shape[1], np.zeros(len(log.t))
    signals = {"q": log.state.q, "e": log.e, "lower": log.envelope.lower, "upper": log.envelope.upper, "tau": log.tau}
    listed = [{"name": key, "title": key, "unit": "", "width": n} for key in signals]
    listed.append({"name": "assumption_violated", "title": "", "unit": "", "width": 1})
    common = {"inputs": 1 + n, "signals": listed, "rows": len(log.t), "log_every": float(log.t[1])}
    motion = scenario.trajectory, scenario.t1
    description = json.loads(json.dumps(scenario.description.model_dump(exclude_unset=True)))
    return {
        "format": 1,
        "title": "Feel the envelope",
        "made_by": "slidax test",
        "first": {"arm": ARM, "scheme": "cftsmppc"},
        "arms": [arm_entry(scenario.plant.robot, ARM, "Two-link arm", [60.0] * n, np.inf, *motion)],
        "programs": [
            {"id": name, "wasm": doubles(log.t, *signals.values(), warning + value), **common}
            for name, value in (("good", 0), ("bad", 1))
        ],
        "settings": [
            setting("cftsmppc", "CFTSMPPC, sampled-data", 1.0, "ours", n, description),
            setting("printed", "CFTSMPPC as printed", 3.0, "printed", n, description),
            setting(RIVAL, "computed torque + PD", 1.5, "rival", n, description),
        ],
    }


def setting(scheme, title, scale, kind, n, description):
    k1 = description["scheme"]["surface"]["k1"]
    delay = {"path": "sensor.delay", "title": "Delay of the measurements", "unit": "periods"}
    statements = [
        certificate("tracking_bound", True, "The period is short enough.", ["scheme"], 0.4, [0.1, 0.2]),
        certificate("torque_budget", False, "The drives may be too weak.", ["robot"], 0.4, [0.1, 0.2]),
        certificate("ultimate_bound", None, "No bound was found.", [], None, None),
    ]
    return {
        **{"arm": ARM, "scheme": scheme, "title": title, "kind": kind, "printed": kind == "printed"},
        "note": "A play-back: only the first slider does anything." if kind == "ours" else "",
        "choices": [{**delay, "values": [1, 0], "default": 0}],
        "variants": [{"at": [0], "program": "good"}, {"at": [1], "program": "bad"}],
        "tunables": [
            tunable("disturbance.scale", "Scale of the error", "World", "", (0.01, 100.0), scale, [0, 1]),
            tunable("robot.plant.coulomb", "Coulomb friction", "World", "N m", (0.0, 5.0), [0.5] * n, [1, n]),
            tunable("scheme.surface.k1", "k₁", "Sliding surface", "1/s", (0.01, 10.0), k1, [1, 1]),
        ],
        "constants": doubles([scale] + [0.0] * n),
        "scenario": description,
        "c_files": packed(json.dumps({"law.h": "#define K1 @{k1}\n", "law.c": "int law;\n"}).encode()),
        "c_parameters": {"file": "law.h", "values": [{"path": "scheme.surface.k1", "marks": ["@{k1}"]}]},
        "certificates": statements,
    }


def tunable(path, title, group, unit, ends, default, inputs):
    scale = "log" if ends[0] > 0 else "linear"
    names = {"path": path, "title": title, "group": group, "unit": unit, "meaning": f"{title}, as a page explains it"}
    return {**names, **dict(zip(("low", "high"), ends, strict=True)), "default": default, "scale": scale,
            "inputs": inputs, "each": isinstance(default, list)}  # fmt: skip


def certificate(name, holds, statement, reads, margin, bound):
    return {"certificate": name, "holds": holds, "statement": statement, "reads": reads, "margin": margin,
            "bound": bound}  # fmt: skip
