"""A playground in the page's format, made of runs of ours: its programs only play back what was logged."""

from __future__ import annotations

import base64
import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np

import slidax as sx
from slidax.report.replay import Skeleton, skeleton_of

FAKE_LOOP = (Path(__file__).parent / "fake_loop.js").read_text(encoding="utf-8")
ARMS = {"two-link": ("Two-link arm", "example-4.1-1khz"), "panda": ("Franka Panda", "panda-payload")}
RIVAL = "computed_torque"


def packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode()


def doubles(*arrays: Any) -> str:
    return packed(b"".join(np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays))


def fake_playground(arms: tuple[str, ...] = ("two-link",)) -> dict[str, Any]:
    """With the scheme of the scenario, the same as printed (here: three times its error), and a rival (1.5 times)."""
    made: dict[str, Any] = {
        "format": 1,
        "title": "Feel the envelope",
        "made_by": "slidax test",
        "first": {"arm": arms[0], "scheme": "cftsmppc"},
        "arms": [],
        "programs": [],
        "settings": [],
    }
    for arm in arms:
        title, name = ARMS[arm]
        _add(made, arm, title, sx.scenarios.load(name))
    return made


def _add(made: dict[str, Any], arm: str, title: str, scenario: Any) -> None:
    run = scenario.simulate()
    bones = skeleton_of(scenario.plant.robot)
    n, log = bones.joints, run.log
    torque = {"two-link": [60.0] * n}.get(arm, [87.0] * 4 + [12.0] * 3)
    made["arms"].append(
        {"id": arm, "title": title, "joints": n, **_body(bones), "limits": {"torque": torque, "rate": None}}
    )
    warned = np.zeros(len(log.t))
    signals = {"q": log.state.q, "e": log.e, "lower": log.envelope.lower, "upper": log.envelope.upper, "tau": log.tau}
    listed = [{"name": key, "title": key, "unit": "", "width": n} for key in signals]
    listed.append({"name": "assumption_violated", "title": "", "unit": "", "width": 1})
    for late in (False, True):
        made["programs"].append(
            {
                "id": f"{arm}-{late}",
                "wasm": doubles(log.t, *signals.values(), warned if not late else warned + 1),
                "inputs": 1 + n,
                "signals": listed,
                "rows": len(log.t),
                "log_every": float(log.t[1]),
            }
        )
    described = json.loads(json.dumps(scenario.description.model_dump(exclude_unset=True)))
    for scheme, name, scale, kind in (
        ("cftsmppc", "CFTSMPPC, sampled-data", 1.0, "ours"),
        ("printed", "CFTSMPPC as printed", 3.0, "printed"),
        (RIVAL, "computed torque + PD", 1.5, "rival"),
    ):
        made["settings"].append(
            {
                "arm": arm,
                "scheme": scheme,
                "title": name,
                "kind": kind,
                "printed": kind == "printed",
                "note": "A play-back: only the first slider does anything." if kind == "ours" else "",
                "choices": [
                    {
                        "path": "sensor.delay",
                        "title": "Delay of the measurements",
                        "unit": "periods",
                        "values": [1, 0],
                        "default": 0,
                    }
                ],
                "variants": [{"at": [0], "program": f"{arm}-False"}, {"at": [1], "program": f"{arm}-True"}],
                "tunables": _tunables(described, n, scale),
                "constants": doubles([scale] + [0.0] * n),
                "scenario": described,
                "c_files": packed(json.dumps({"law.h": "#define K1 @{k1}\n", "law.c": "int law;\n"}).encode()),
                "c_parameters": {"file": "law.h", "values": [{"path": "scheme.surface.k1", "marks": ["@{k1}"]}]},
                "certificates": _certificates(),
            }
        )


def _tunables(described: dict[str, Any], n: int, scale: float) -> list[dict[str, Any]]:
    k1 = described["scheme"]["surface"]["k1"]
    return [
        {
            "path": "disturbance.scale",
            "title": "Scale of the error",
            "group": "World",
            "unit": "",
            "low": 0.01,
            "high": 100.0,
            "default": scale,
            "scale": "log",
            "inputs": [0, 1],
            "meaning": "How many times the error is what it was",
            "each": False,
        },
        {
            "path": "robot.plant.coulomb",
            "title": "Coulomb friction",
            "group": "World",
            "unit": "N m",
            "low": 0.0,
            "high": 5.0,
            "default": [0.5] * n,
            "scale": "linear",
            "inputs": [1, n],
            "meaning": "Friction of each joint that does not depend on its speed",
            "each": True,
        },
        {
            "path": "scheme.surface.k1",
            "title": "k₁",
            "group": "Sliding surface",
            "unit": "1/s",
            "low": 0.01,
            "high": 10.0,
            "default": k1,
            "scale": "log",
            "inputs": [1, 1],
            "meaning": "Gain of the linear part of the surface, eq. (16)",
            "each": False,
        },
    ]


def _certificates() -> list[dict[str, Any]]:
    common = {"margin": 0.4, "bound": [0.1, 0.2]}
    return [
        {
            "certificate": "loop_rate",
            "holds": True,
            "statement": "The period is short enough.",
            "reads": ["scheme"],
            **common,
        },
        {
            "certificate": "torque_budget",
            "holds": False,
            "statement": "The drives may be too weak.",
            "reads": ["robot"],
            **common,
        },
        {
            "certificate": "ultimate_bound",
            "holds": None,
            "statement": "No bound was found.",
            "reads": [],
            "margin": None,
            "bound": None,
        },
    ]


def _body(bones: Skeleton) -> dict[str, Any]:
    """Links, capsules between the joints, and a drum around each."""
    from scipy.spatial.transform import Rotation

    def quaternion(matrix: Any) -> list[float]:
        x, y, z, w = Rotation.from_matrix(np.asarray(matrix)).as_quat().tolist()
        return [w, x, y, z]

    def between(end: Any) -> list[float]:
        end = np.asarray(end)
        turn = Rotation.align_vectors(end[None] / np.linalg.norm(end), np.array([[0.0, 0.0, 1.0]]))[0].as_matrix()
        return [*(end / 2).tolist(), *quaternion(turn)]

    radius = 0.045 * bones.reach
    links = []
    shapes = []
    for joint, parent in enumerate(bones.parents):
        place = bones.translations[joint]
        links.append(
            {
                "name": bones.names[joint],
                "parent": parent,
                "origin": [*place.tolist(), *quaternion(bones.rotations[joint])],
                "axis": [0.0, 0.0, 1.0],
                "type": "revolute" if bones.revolute[joint] else "prismatic",
                "joint": joint,
            }
        )
        long = float(np.linalg.norm(place))
        if long > 0.2 * radius:
            shapes.append(
                {"link": parent, "kind": "capsule", "size": [radius * 0.9, long], "at": between(place), "tone": 0}
            )
        shapes.append(
            {
                "link": joint,
                "kind": "cylinder",
                "size": [1.15 * radius, 2.6 * radius],
                "at": [0, 0, 0, 1, 0, 0, 0],
                "tone": 1,
            }
        )
    tip = bones.tip_translation
    size = [0.7 * radius, float(np.linalg.norm(tip))]
    shapes.append({"link": bones.tip_joint, "kind": "capsule", "size": size, "at": between(tip), "tone": 0})
    shapes.append(
        {
            "link": bones.tip_joint,
            "kind": "sphere",
            "size": [0.85 * radius],
            "at": [*tip.tolist(), 1, 0, 0, 0],
            "tone": 2,
        }
    )
    return {
        "kinematics": links,
        "shapes": shapes,
        "tip": {"link": bones.tip_joint, "at": tip.tolist()},
        "up": bones.up.tolist(),
    }
