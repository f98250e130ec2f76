"""The closed loop of a scenario as WebAssembly, with numbers of the scenario as its inputs."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax._errors import DefinitionError
from slidax._types import Envelope, Reference, State
from slidax.codegen.wasm import Module, wasm_module
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family, Templates
from slidax.simulation import BANDS, MujocoPlant
from slidax.simulation.define import define_loop
from slidax.simulation.loop import Carry, Loop
from slidax.simulation.native_loop import NativeLoop, lowered
from slidax.simulation.rollout import begin, sample

from .signals import TITLES, signals_of

ROWS = 1000
"""About as many rows as a run's log has: as many as a chart has pixels."""

CHUNK = 250
"""About how many samples pass in one call, so that a browser's better compiler takes over soon."""


@dataclass(frozen=True)
class LoopProgram:
    """A closed loop for a browser.

    - `module`: the WebAssembly.
    - `entry`: how the page's runtime calls it, as JSON; see `docs/web.md`.
    """

    module: Module
    entry: Mapping[str, Any]


def loop_program(family: Family, templates: Templates, shapes: Mapping[str, tuple[int, ...]]) -> LoopProgram:
    """The program of a scenario.

    - `family`: the scenario, with the paths that vary.
    - `templates`: the scenario, built.
    - `shapes`: of the numbers that are inputs, by path.

    Raises DefinitionError if MuJoCo moves the arm, or there is no code for something in it.
    """
    built = templates.built
    if isinstance(built.plant, MujocoPlant):
        raise DefinitionError("a page cannot run MuJoCo: set `simulation.plant` to `own`")
    counted: list[int] = []
    promised: list[bool] = []

    def define(given: Array) -> tuple[Loop, State]:
        # What does not depend on the inputs is known, and checked, while this is traced.
        with jax.ensure_compile_time_eval():
            plant, controller, trajectory, state0, *tube = family.parts(templates, _values(shapes, given))
            assert not isinstance(plant, MujocoPlant)
            loop, samples = define_loop(
                plant, controller, trajectory, state0, built.t1, built.stepping, 1, BANDS, *tube
            )
        counted[:] = [samples]
        return loop, state0

    def begun(given: Array) -> tuple[Carry, dict[str, Array]]:
        loop, state = define(given)
        carry, envelope, reference, held = begin(loop, state)
        promised[:] = [envelope is not None]
        return carry, _start(loop, state, envelope, reference, held)

    def turned(given: Array, carry: Carry) -> tuple[Carry, dict[str, Array]]:
        after, log = sample(define(given)[0], carry)
        return after, {"valid": log.valid, **signals_of(define(given)[0], carry, log)}

    size = sum(int(np.prod(shape, dtype=int)) for shape in shapes.values())
    inputs = jax.ShapeDtypeStruct((size,), float)
    native = lowered(begun, turned, inputs, logged=True, batch=False, known=True)
    module = wasm_module(native.program)
    return LoopProgram(module, _entry(native, module, size, counted[0], promised[0], built))


def _values(shapes: Mapping[str, tuple[int, ...]], given: Array) -> dict[str, Array]:
    found, first = {}, 0
    for path, shape in shapes.items():
        size = int(np.prod(shape, dtype=int))
        found[path] = given[first : first + size].reshape(shape)
        first += size
    return found


def _start(loop: Loop, state: State, envelope: Envelope | None, reference: Reference, held: Any) -> dict[str, Array]:
    """What says whether the run may begin: see `slidax.simulation.define.require_start`."""
    e = state.q - reference.q
    found = {"e": e}
    if held is not None and loop.plant.actuator is not None:
        found |= {"held": held, "limit": jnp.broadcast_to(loop.plant.actuator.limits.torque, held.shape)}
    if loop.tube is not None:
        judged = loop.tube.envelope(jnp.zeros(()), loop.tube.init(jnp.zeros(()), e))
        found |= {"tube_lower": judged.lower, "tube_upper": judged.upper}
    if envelope is not None and not loop.recover:
        found |= {"lower": envelope.lower, "upper": envelope.upper}
    return found


def _entry(
    native: NativeLoop, module: Module, size: int, samples: int, has_envelope: bool, built: Scenario
) -> dict[str, Any]:
    carried = len(jax.tree.leaves(native.begun[0]))
    names = [output.name for output in native.program.outputs]
    logged = len(jax.tree.leaves(native.log))
    every = max(1, (samples - 1) // ROWS)
    n = built.plant.robot.joints
    units = built.plant.robot.joint_units
    of = {"position": units, "torque": tuple("N m" if unit == "rad" else "N" for unit in units), "": ("",) * n}
    signals = []
    for name, (_, width, _) in zip(names[:logged], module.outputs[:logged], strict=True):
        short = name.removeprefix("log.")
        if short in TITLES:
            title, unit = TITLES[short]
            signals.append({"name": short, "title": title, "unit": of[unit][0], "units": of[unit], "width": width})
    return {
        "id": module.digest[:12],
        "wasm": packed(module.bytes),
        "inputs": size,
        "signals": signals,
        "rows": -(-samples // every),
        "log_every": every * built.period,
        "samples": samples,
        "every": every,
        "chunk": max(1, CHUNK // every) * every,
        "period": built.period,
        "t1": built.t1,
        "joints": n,
        "joint_units": units,
        "joint_names": built.plant.robot.joint_names,
        "bands": BANDS,
        "has_envelope": has_envelope,
        "reads": [list(entry) for entry in module.inputs],
        "writes": [[name, *entry] for name, entry in zip(names, module.outputs, strict=True)],
        "carried": carried,
    }


def packed(data: bytes) -> str:
    """Bytes as a page holds them: gzip in base64, the same for the same bytes.

    - `data`: the bytes.
    """
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
