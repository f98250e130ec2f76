"""The closed loop as a WebAssembly program, with tunable values (those with a slider) as inputs."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax.codegen.wasm.module import Module, wasm_module
from slidax.core.errors import is_traced
from slidax.core.types import Envelope, Reference, State
from slidax.scenarios.family import Family, Templates
from slidax.simulation.define import define_loop
from slidax.simulation.loop import Carry, ClosedLoop, begin, sample
from slidax.simulation.native_loop import NativeLoop, lower_loop
from slidax.simulation.plant import MujocoPlant
from slidax.simulation.run import Log
from slidax.simulation.simulate import BANDS

TITLES = {
    "q": ("position", "position"),
    "e": ("error", "position"),
    "rho": ("radius of the envelope", "position"),
    "lower": ("lower bound of the error", "position"),
    "upper": ("upper bound of the error", "position"),
    "tau": ("torque", "torque"),
    "margin": ("distance to the nearer bound, as a share of the envelope's width", ""),
    "assumption_violated": ("1 where the law's monitor reports its guarantee void", ""),
}
"""Title of each signal on the page, and the quantity whose unit the signal has."""


def signals_of(loop: ClosedLoop, before: Carry, log: Log) -> dict[str, Any]:
    """Return the signals that a page logs at one sample, by name, each a scalar or [n].

    Bounds are those of the scheme's envelope, or of the tolerance band that judges a scheme without an envelope.

    - `before`: state of the loop before the sample.
    - `log`: logged values of the sample.
    """
    e = log.e
    signals = {"t": log.t, "q": log.state.q, "e": e, "tau": log.tau}
    bounds = bounds_of(loop, before, log)
    if bounds is not None:
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        signals |= {"lower": bounds.lower, "upper": bounds.upper, "margin": nearer}
        signals["rho"] = jnp.maximum(bounds.upper, -bounds.lower)
    if before.tally.promise is not None:
        signals["assumption_violated"] = (log.signals["margin"] < 0.0).astype(float)
    return signals


def bounds_of(loop: ClosedLoop, before: Carry, log: Log) -> Envelope | None:
    """Return the error bounds of the scheme's envelope, else of the tolerance band; None if there is neither."""
    if log.envelope is not None or loop.tolerance is None:
        return log.envelope
    assert before.tally.tolerance is not None
    t: Any = log.t
    return loop.tolerance.envelope(t, before.tally.tolerance.sides)


ROWS = 1000
"""Approximate number of rows in a run's log: as many as a chart has pixels."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A scenario that a page can run, with the values that are inputs of its program.

    An input is named by its path in the scenario, with dots, as in `--set`.

    - `family`: the scenario's description, with the paths of the inputs.
    - `templates`: the objects built from this description.
    - `defaults`: values of the inputs in the scenario, by path.
    """

    family: Family
    templates: Templates
    defaults: Mapping[str, np.ndarray]

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the inputs, by path."""
        return {path: value.shape for path, value in self.defaults.items()}

    def loop(self, values: Mapping[str, Any]) -> tuple[ClosedLoop, State]:
        """Return the closed loop and its initial state for new values of some inputs, by path; others have defaults."""
        built = self.templates.built
        plant, controller, trajectory, state0, *tolerance = self.family.parts(self.templates, values)
        assert not isinstance(plant, MujocoPlant)
        loop = define_loop(plant, controller, trajectory, state0, built.t1, built.stepping, 1, BANDS, *tolerance)[0]
        return loop, state0

    @cached_property
    def parted(self) -> tuple[list[Any], Any, Any]:
        """The loop's arrays as a list, the structure of their pytree, and the loop without its arrays."""
        arrays, rest = eqx.partition(self.loop({}), eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        return leaves, tree, rest

    @property
    def form(self) -> Any:
        """A key: variants with equal `form` can share a program, since they differ only in the values of arrays."""
        leaves, tree, rest = self.parted
        others, other_tree = jax.tree.flatten(rest)
        return tree, tuple((leaf.shape, leaf.dtype.name) for leaf in leaves), other_tree, tuple(others)

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return round(self.templates.built.t1 / self.templates.built.period) + 1

    @property
    def every(self) -> int:
        """Logging stride [samples]."""
        return max(1, (self.samples - 1) // ROWS)

    @cached_property
    def varies(self) -> list[bool]:
        """For each array of the loop, True if it depends on the inputs."""
        varies: list[bool] = []

        def probe(inputs: Array) -> int:
            varies[:] = [is_traced(leaf) for leaf in self.leaves(inputs)]
            return 0

        jax.eval_shape(probe, jax.ShapeDtypeStruct((self.size,), float))
        return varies

    @property
    def size(self) -> int:
        """Length of the input vector."""
        return sum(int(np.prod(shape, dtype=int)) for shape in self.shapes.values())

    @cached_property
    def depends(self) -> list[set[str]]:
        """For each array of the loop, the paths of the inputs on which it depends."""
        inputs = [jax.ShapeDtypeStruct(shape, float) for shape in self.shapes.values()]
        jaxpr = jax.make_jaxpr(lambda *values: self._arrays(dict(zip(self.shapes, values, strict=True))))(*inputs).jaxpr
        known: dict[Any, set[str]] = {atom: {path} for atom, path in zip(jaxpr.invars, self.shapes, strict=True)}

        def of(atoms: Sequence[Any]) -> set[str]:
            return set().union(*(known.get(atom, set()) for atom in atoms if not hasattr(atom, "val")))

        for equation in jaxpr.eqns:
            known.update(dict.fromkeys(equation.outvars, of(equation.invars)))
        return [of([atom]) for atom in jaxpr.outvars]

    def values(self, inputs: Array) -> dict[str, Array]:
        """Split the input vector into the inputs; return their values by path."""
        values, first = {}, 0
        for path, shape in self.shapes.items():
            size = int(np.prod(shape, dtype=int))
            values[path] = inputs[first : first + size].reshape(shape)
            first += size
        return values

    def leaves(self, inputs: Array) -> list[Any]:
        """Return the arrays of the loop for an input vector, in the order of `parted`."""
        return self._arrays(self.values(inputs))

    def _arrays(self, values: Mapping[str, Array]) -> list[Any]:
        # During tracing, values that do not depend on the inputs stay concrete, so that they are checked.
        with jax.ensure_compile_time_eval():
            arrays, _ = eqx.partition(self.loop(values), eqx.is_array)
        return jax.tree.leaves(arrays)


@dataclass(frozen=True)
class LoopProgram:
    """A closed loop in WebAssembly for a browser, shared by several variants.

    - `module`: the WebAssembly module.
    - `entry`: its call interface as JSON data; see `docs/browser.md`.
    - `constants`: for each variant, the rest of its input vector, which follows the tunable values.
    """

    module: Module
    entry: Mapping[str, Any]
    constants: Sequence[np.ndarray]


def loop_program(variants: Sequence[Variant]) -> LoopProgram | None:
    """Compile one program that runs several variants of a closed loop, which must all have the same `form`.

    The program's inputs are the tunable values, the arrays that differ between the variants, the number of samples, and
    the logging stride [samples]. Returns None if an array differs between the variants and also depends on the tunable
    values.

    Raises DefinitionError if an operation of the loop cannot be compiled.
    """
    variant0 = variants[0]
    fixed, tree, rest = variant0.parted
    each = [[np.asarray(leaf) for leaf in variant.parted[0]] for variant in variants]
    differs = [any(not np.array_equal(leaf, other[k]) for other in each) for k, leaf in enumerate(each[0])]
    if any(map(all, zip(differs, variant0.varies, strict=True))):
        return None
    promised: list[bool] = []

    def beforehand(both: tuple[Array, list[Array]]) -> list[Array]:
        # All arrays are traced, as in a simulation in Python, so that both round in the same way.
        values_in, known = both
        leaves, first = variant0.leaves(values_in[: variant0.size]), variant0.size
        values = variant0.values(values_in[: variant0.size])
        for k, leaf in enumerate(fixed):
            if differs[k]:
                leaves[k] = values_in[first : first + leaf.size].reshape(leaf.shape).astype(leaf.dtype)
                first += leaf.size
            elif not variant0.varies[k]:
                leaves[k] = known[k]
            else:
                # With the default inputs, the array has exactly its value in Python.
                same = [jnp.all(values[path] == variant0.defaults[path]) for path in variant0.depends[k]]
                leaves[k] = jnp.where(jnp.all(jnp.stack(same)), known[k], leaves[k])
        return leaves

    def define(leaves: list[Array]) -> tuple[ClosedLoop, State]:
        return eqx.combine(jax.tree.unflatten(tree, leaves), rest)

    def begun(varied: list[Array]) -> tuple[Carry, dict[str, Array]]:
        loop, state = define(varied)
        carry, envelope, reference, held = begin(loop, state)
        promised[:] = [envelope is not None]
        return carry, _start(loop, state, envelope, reference, held)

    def turned(varied: list[Array], carry: Carry) -> tuple[Carry, dict[str, Any]]:
        loop = define(varied)[0]
        after, log = sample(loop, carry)
        return after, {"valid": log.valid, **signals_of(loop, carry, log)}

    besides = sum(leaf.size for k, leaf in enumerate(fixed) if differs[k])
    inputs = jax.ShapeDtypeStruct((variant0.size + besides,), float)
    both = (inputs, [jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in fixed])
    native = lower_loop(begun, turned, both, logged=True, batch=False, beforehand=beforehand)
    first = len(native.consts)
    known = dict(enumerate(native.consts)) | {first + 1 + k: leaf for k, leaf in enumerate(each[0])}
    module = wasm_module(native.program, known)
    constants = [
        np.array(
            [
                *(float(x) for k, leaf in enumerate(leaves) if differs[k] for x in leaf.ravel()),
                float(variant.samples),
                float(variant.every),
            ]
        )
        for variant, leaves in zip(variants, each, strict=True)
    ]
    return LoopProgram(module, _entry(native, module, variants, variant0.size + besides, promised[0]), constants)


def _start(
    loop: ClosedLoop, state: State, envelope: Envelope | None, reference: Reference, held: Any
) -> dict[str, Array]:
    """Return the values that determine if the run may begin: see `slidax.simulation.define.require_start`."""
    e = state.q - reference.q
    start = {"e": e, "period": loop.period}
    if held is not None and loop.plant.actuator is not None:
        start |= {"held": held, "limit": jnp.broadcast_to(loop.plant.actuator.limits.torque, held.shape)}
    if loop.tolerance is not None:
        judged = loop.tolerance.envelope(jnp.zeros(()), loop.tolerance.init(jnp.zeros(()), e))
        start |= {"tolerance_lower": judged.lower, "tolerance_upper": judged.upper}
    if envelope is not None and not loop.recover:
        start |= {"lower": envelope.lower, "upper": envelope.upper}
    return start


def _entry(
    native: NativeLoop, module: Module, variants: Sequence[Variant], size: int, has_envelope: bool
) -> dict[str, Any]:
    built = variants[0].templates.built
    carried = len(jax.tree.leaves(native.start[0]))
    names = [output.name for output in native.program.outputs]
    logged = len(jax.tree.leaves(native.log))
    robot = built.plant.robot
    of = {"position": robot.joint_units, "torque": robot.torque_units, "": ("",) * robot.joints}
    signals = []
    for name, (_, width, _) in zip(names[:logged], module.outputs[:logged], strict=True):
        short = name.removeprefix("log.")
        if short in TITLES:
            title, unit = TITLES[short]
            signals.append({"name": short, "title": title, "unit": of[unit][0], "units": of[unit], "width": width})
    layout = {
        "code": {
            "from": module.code[0],
            "to": module.code[1],
            "entry": module.entry_at,
            "once": module.once,
            "twice": module.twice,
            "others": list(module.others),
        },
        "reads": [list(entry) for entry in module.inputs],
        "writes": [[name, *entry] for name, entry in zip(names, module.outputs, strict=True)],
        "carried": carried,
    }
    return {
        "id": module.digest[:12],
        "wasm": pack_bytes(module.bytes),
        "layout": pack_bytes(json.dumps(layout, separators=(",", ":")).encode()),
        "inputs": size + 2,
        "signals": signals,
        "rows": max(-(-variant.samples // variant.every) for variant in variants),
        "log_every": variants[0].every * built.period,
        "t1": built.t1,
        "joints": robot.joints,
        "joint_units": robot.joint_units,
        "joint_names": robot.joint_names,
        "bands": BANDS,
        "has_envelope": has_envelope,
    }


def pack_bytes(data: bytes) -> str:
    """Return bytes as text for a page: gzip without a time stamp, in base64."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
