"""Machine code and memory layout for the two sides of a sampled loop: the guarded law, and the simulated arm.

A plan is machine code with the initial content of its memory, to be sent to another process. A tick is an instant at
which the simulated arm can apply a new torque; two ticks are one sample time apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.codegen import llvm
from slidax.codegen.trace.tracing import trace
from slidax.core.errors import DefinitionError
from slidax.core.types import Reference, Scalar, State, Vector
from slidax.plant.sensors import AbstractSensor, Delayed, Lossy
from slidax.runtime.logs.messages import Channels
from slidax.runtime.shared_memory import CodePlan, MachineCode, Slot
from slidax.simulation.define import define_loop
from slidax.simulation.loop import ClosedLoop, HeldTorque, force, move_plant
from slidax.simulation.plant import MujocoPlant, Plant
from slidax.simulation.simulate import BANDS

from .guarded_step import GuardedStep, guarded_law
from .status import CONDITIONS, StepMemory

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

WORD = 8
"""Alignment of arrays in the memory of a plan [bytes]."""


class Planner:
    """Builder of a plan: allocates arrays in one block of memory, and compiles code that reads and writes them.

    A slot is an array's position in the block, with its shape and dtype.

    Raises DefinitionError if llvmlite is not installed.
    """

    def __init__(self) -> None:
        if not llvm.available():
            raise DefinitionError(
                "running a law sample by sample needs llvmlite, which is not installed: pip install 'slidax[native]'"
            )
        self._parts: list[np.ndarray] = []
        self._size = 0
        self._routines: dict[str, MachineCode] = {}
        self._views: dict[str, Slot] = {}
        self._regions: dict[str, tuple[int, int]] = {}

    def allocate(self, tree: Any, name: str = "") -> Any:
        """Allocate each array of a tree; return a tree of their slots.

        - `tree`: arrays with their initial values; or shapes, whose arrays start as zeros.
        - `name`: name under which the plan lists the region of all these arrays; empty for none.
        """
        start = self._size
        placed = jax.tree.map(self._put, tree)
        if name:
            self._regions[name] = (start, self._size)
        return placed

    def view(self, name: str, array: Any) -> Slot:
        """Allocate one array, and name it; return its slot."""
        self._views[name] = slot = self._put(array)
        return slot

    def named(self, name: str, slot: Slot) -> None:
        """Name an allocated array."""
        self._views[name] = slot

    def region(self, name: str, first: Slot, last: Slot) -> None:
        """Name the region from one array to another, both included."""
        self._regions[name] = (first.offset, -(-last.end // WORD) * WORD)

    def code(self, name: str, kernel: llvm.Kernel, inputs: Any, outputs: Any) -> None:
        """Add a compiled kernel under a name; it reads the slots in `inputs` and writes those in `outputs` (trees)."""
        slots: list[Slot] = [*jax.tree.leaves(inputs, is_leaf=_is_slot), *jax.tree.leaves(outputs, is_leaf=_is_slot)]
        shapes = [*(entry.shape for entry in kernel.inputs), *(entry.shape for entry in kernel.outputs)]
        assert [slot.shape for slot in slots] == shapes
        self._routines[name] = MachineCode(kernel.object, kernel.entry, tuple(slot.offset for slot in slots))

    def compile(self, name: str, function: Callable[..., Any], inputs: tuple[Any, ...], outputs: Any) -> None:
        """Compile a function of trees of arrays, and add its code under a name.

        - `inputs`: for each argument of the function, a tree of the slots that the code reads.
        - `outputs`: tree of the slots to which the code writes the result.
        """
        shapes = jax.tree.map(lambda slot: jax.ShapeDtypeStruct(slot.shape, slot.dtype), inputs, is_leaf=_is_slot)
        self.code(name, kernel(function, *shapes)[0], inputs, outputs)

    def plan(self) -> CodePlan:
        """Return the plan: all code that has been added, and the allocated memory with its initial content."""
        return CodePlan(b"".join(part.tobytes() for part in self._parts), self._routines, self._views, self._regions)

    def _put(self, array: Any) -> Slot:
        shape, dtype = tuple(np.shape(array)), np.dtype(array.dtype)
        if isinstance(array, jax.ShapeDtypeStruct):
            shape, held = tuple(array.shape), np.zeros(array.shape, dtype)
        else:
            held = np.asarray(array)
        slot = Slot(self._size, shape, dtype.str)
        bytes_ = np.frombuffer(held.tobytes(), np.uint8)
        # No two arrays share a word.
        padded = np.zeros(-(-len(bytes_) // WORD) * WORD, np.uint8)
        padded[: len(bytes_)] = bytes_
        self._parts.append(padded)
        self._size += len(padded)
        return slot


def kernel(function: Callable[..., Any], *args: Any) -> tuple[llvm.Kernel, Any]:
    """Compile a function of trees of arrays; return the kernel (compiled code), and the tree of the result's shapes.

    - `args`: the function's arguments, as arrays or as their shapes.

    Raises NoNativeCodeError if an operation of the function has no machine code.
    """
    shapes: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        result = function(*args)
        # The shapes are recorded during this trace, since a second trace of a law would take seconds.
        shapes[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), result)]
        return result

    compiled = llvm.compile(trace(arrays_of, *args, named=False))
    return compiled, shapes[0]


def _is_slot(x: Any) -> bool:
    return isinstance(x, Slot)


REFERENCE_COLUMNS = ("q_d", "dq_d", "ddq_d", "q_d_next", "dq_d_next", "ddq_d_next")
"""Columns of the reference at a sample, and one period later."""

NUMBER, WHOLE = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((), int)


@dataclass(frozen=True)
class LawPlan:
    """A law, compiled to be called sample by sample.

    - `plan`: its code and memory.
    - `row`: NumPy dtype of a log row: inputs, results and computing times of one sample.
    - `sample`: dtype of the inputs in a row: time, measurement, reference.
    - `channels`: joints, signals and status bits in its log.
    """

    plan: CodePlan
    row: np.dtype[Any]
    sample: np.dtype[Any]
    channels: Channels

    def columns(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return the log columns of recorded rows by name, with those derived from them, such as status bits.

        - `rows`: array of bytes, one row of `row.itemsize` bytes per sample.
        """
        table = np.ascontiguousarray(rows).view(self.row)[:, 0] if len(rows) else np.zeros(0, self.row)
        columns = {name: table[name] for name in self.row.names or ()}
        for bit, name in enumerate(self.channels.bits):
            columns[name.lower()] = (columns["status"] >> bit) & 1
        if self.channels.bounded:
            below, above = columns["e"] - columns["lower"], columns["upper"] - columns["e"]
            with np.errstate(invalid="ignore", divide="ignore"):
                columns["envelope_margin"] = np.minimum(below, above) / (columns["upper"] - columns["lower"])
        return columns


def require_samples(scenario: Scenario) -> None:
    """Raise DefinitionError if a scenario is not in held mode, in which the law runs once per sample."""
    if scenario.stepping.mode != "held":
        raise DefinitionError(
            "running a law sample by sample needs held mode: `--set simulation.mode=held`, or a scenario "
            "such as example-4.1-1khz"
        )


def arm_to_move(scenario: Scenario) -> Plant:
    """Return a scenario's plant for a loop sample by sample, as slidax's own simulator uses it.

    For an arm in MuJoCo this is `MujocoPlant.with_friction`; MuJoCo still moves the arm.

    Raises DefinitionError if the arm has LuGre friction or elastic joints.
    """
    plant = scenario.plant
    own = plant.with_friction if isinstance(plant, MujocoPlant) else plant
    if own.transmission is not None:
        raise DefinitionError(
            "LuGre friction and elastic joints cannot be simulated sample by sample, as in `slidax loop` and for an "
            "`.mcap` log: leave `transmission` out, or use `slidax run` without such a log"
        )
    return own


def law_plan(scenario: Scenario) -> LawPlan:
    """Compile a scenario's law to be called sample by sample.

    Raises DefinitionError if the scenario is not in held mode (one torque per sample), or if llvmlite is not installed;
    NoNativeCodeError if an operation of the law has no machine code.
    """
    require_samples(scenario)
    guard = guarded_law(scenario)
    n = guard.joints
    vector = jax.ShapeDtypeStruct((n,), float)
    state, wanted = _state(vector), _reference(vector)
    planner = Planner()
    numbers = planner.allocate(guard)
    motion_numbers = planner.allocate(scenario.trajectory)
    period = planner.allocate(np.asarray(scenario.period))
    zeros = jax.eval_shape(guard.init, NUMBER, state, wanted)
    memories = [planner.allocate(zeros) for _ in range(2)]

    def motion(trajectory: Any, period: Scalar, t: Scalar) -> tuple[Reference, Reference]:
        return trajectory.reference(t), trajectory.reference(t + period)

    def step(
        guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference, following: Reference
    ) -> Any:
        command, status = guard.step(t, state, now, following, memory)
        envelope = guard.envelope(t, command.memory)
        bounds = () if envelope is None else (envelope.lower, envelope.upper)
        error = state.q - guard.wanted_then(now)
        return command.memory, (command.tau, command.signals, status, error, bounds)

    step_code, (_, shapes) = kernel(step, guard, zeros, NUMBER, state, wanted, wanted)

    fields: dict[str, Slot] = {name: planner.view(name, WHOLE) for name in ("k", "basis")}
    fields["t"] = planner.view("t", NUMBER)
    for name in ("q", "dq", "effort", *REFERENCE_COLUMNS):
        fields[name] = planner.view(name, vector)
    tau, signals, status, error, bounds = planner.allocate(shapes)
    fields |= {"tau": tau, "status": status, "e": error}
    fields |= dict(zip(("lower", "upper"), bounds, strict=False))
    fields |= {f"signal:{name}": slot for name, slot in signals.items()}
    for name in ("wake", "took", "response", "logged"):
        fields[name] = planner.view(name, NUMBER)
    planner.named("status", status)
    first, last = fields["k"], fields["logged"]
    for name, start, end in (
        ("row", first, last),
        ("measured", fields["q"], fields["effort"]),
        ("sample", fields["t"], fields[REFERENCE_COLUMNS[-1]]),
        ("tau", tau, tau),
    ):
        planner.region(name, start, end)
    references = [fields[name] for name in REFERENCE_COLUMNS]
    sample = (fields["t"], fields["q"], fields["dq"], *references)
    planner.compile("motion", motion, (motion_numbers, period, fields["t"]), references)
    for at in range(2):
        answer = (memories[1 - at], (tau, signals, status, error, bounds))
        planner.code(f"step_{at}", step_code, (numbers, memories[at], *sample), answer)
    names = ("t", "q", "dq", "effort", *REFERENCE_COLUMNS)
    robot = scenario.plant.robot
    return LawPlan(
        plan=planner.plan(),
        row=dtype_of(fields, first, last),
        sample=dtype_of({name: fields[name] for name in names}, fields["t"], references[-1]),
        channels=Channels(
            joints=tuple(robot.joint_names),
            units=tuple(robot.joint_units),
            signals={name: slot.shape[0] if slot.shape else None for name, slot in signals.items()},
            bounded=bool(bounds),
            bits=tuple(condition.name for condition in CONDITIONS),
        ),
    )


def dtype_of(fields: dict[str, Slot], first: Slot, last: Slot) -> np.dtype[Any]:
    """Return the NumPy dtype of the memory from slot `first` to slot `last`; `fields` has the slot of each field."""
    return np.dtype(
        {
            "names": list(fields),
            "formats": [(slot.dtype, slot.shape) for slot in fields.values()],
            "offsets": [slot.offset - first.offset for slot in fields.values()],
            "itemsize": -(-(last.end - first.offset) // 8) * 8,
        }
    )


def _state(vector: Any) -> State:
    return jax.eval_shape(lambda q: State(q, q), vector)


def _reference(vector: Any) -> Reference:
    return jax.eval_shape(lambda q: Reference(q, q, q), vector)


BRAKES_IN = 0.05
"""Time constant with which the brakes stop the arm [s]."""


@dataclass(frozen=True)
class ArmPlan:
    """A simulated arm, compiled to be moved tick by tick.

    - `plan`: its code and memory.
    - `row`: NumPy dtype of a log row: true state, torque and computing times of one tick.
    - `world`: MuJoCo's model, and the joints' position and velocity indices in it; None for slidax's own simulator.
    - `substeps`: MuJoCo steps per tick.
    """

    plan: CodePlan
    row: np.dtype[Any]
    world: tuple[Any, np.ndarray, np.ndarray] | None
    substeps: int

    def columns(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return the log columns of recorded rows by name.

        - `rows`: array of bytes, one row of `row.itemsize` bytes per tick.
        """
        table = np.ascontiguousarray(rows).view(self.row)[:, 0] if len(rows) else np.zeros(0, self.row)
        return {name: table[name] for name in self.row.names or ()}


def advance_sensor(sensor: AbstractSensor | None) -> AbstractSensor:
    """Return the sensor with one period less delay.

    A loop of two processes already takes one period from a measurement to the torque computed from it.

    Raises DefinitionError if the sensor's measurements are less than one period old.
    """
    if isinstance(sensor, Lossy):
        return eqx.tree_at(lambda lossy: lossy.sensor, sensor, advance_sensor(sensor.sensor))
    if not isinstance(sensor, Delayed) or sensor.periods - 0.5 * sensor.jitter < 1:
        raise DefinitionError(
            "in a loop of two processes a measurement is one period old when its torque takes effect, and the law "
            "must account for it: `--set sensor.delay=1`",
            where="sensor.delay",
        )
    if sensor.periods == 1 and not sensor.jitter:
        return sensor.sensor
    return Delayed(sensor.sensor, sensor.periods - 1, sensor.jitter, sensor.seed)


def arm_plan(scenario: Scenario, *, transport: int) -> ArmPlan:
    """Compile a scenario's arm to be moved tick by tick.

    - `transport`: periods from a measurement to the torque computed from it, 0 or 1. With 1 the sensor has one period
      less delay, and the first measurement is taken one tick before tick 0.

    Raises DefinitionError if the scenario is not in held mode (one torque per sample), if its plant or sensor is not
    supported, or if llvmlite is not installed; NoNativeCodeError if an operation of the arm has no machine code.
    """
    require_samples(scenario)
    own, plant = arm_to_move(scenario), scenario.plant
    stepping = scenario.stepping
    loop, _ = define_loop(
        own, scenario.controller, scenario.trajectory, scenario.state0, scenario.t1, stepping, None, BANDS
    )
    sensor = advance_sensor(own.sensor) if transport else own.sensor
    start, period = scenario.state0, loop.period
    before = State(q=start.q - transport * period * start.dq, dq=start.dq)
    first, measurement0 = _first(sensor, before, period, transport)
    held = own.at(jnp.zeros(())).bias(start.q, start.dq)
    # The law itself is not needed here.
    arrays, static = eqx.partition((loop.plant, loop.trajectory, period), eqx.is_array)

    def parts(arrays: Any) -> tuple[Plant, Any, Scalar]:
        return eqx.combine(arrays, static)

    def measure(arrays: Any, k: Any, state: State, memory: Any) -> Any:
        _, trajectory, period = parts(arrays)
        now, fresh, after = state, jnp.ones((), bool), memory
        if sensor is not None:
            measurement, after = sensor(k + transport, state, period, memory)
            now, fresh = measurement.state, measurement.fresh
        t = k.astype(float) * period
        return now, fresh, after, t, (state.q, state.dq, state.q - trajectory.reference(t).q)

    def set_(arrays: Any, k: Any, state: State, delivery: Any, tau: Vector, brakes: Any) -> Any:
        plant, _, period = parts(arrays)
        # Brakes hold the true arm, also with a payload that the law does not know.
        robot = plant.at(k.astype(float) * period)
        stopping = robot.bias(state.q, state.dq) - robot.mass(state.q) @ state.dq / BRAKES_IN
        tau = jnp.where(brakes, stopping, tau)
        if plant.actuator is None:
            return tau, delivery
        return plant.actuator.set(tau, period, delivery)

    def loop_of(arrays: Any) -> ClosedLoop:
        plant, trajectory, period = parts(arrays)
        return eqx.tree_at(lambda loop: (loop.plant, loop.trajectory, loop.period), loop, (plant, trajectory, period))

    def move(arrays: Any, k: Any, state: State, tau: Vector, delivery: Any) -> State:
        current = loop_of(arrays)
        return move_plant(current, state, k.astype(float) * current.period, HeldTorque(tau, delivery))

    def external_torque(arrays: Any, k: Any, i: Any, state: State, tau: Vector, delivery: Any) -> Vector:
        return force(loop_of(arrays), HeldTorque(tau, delivery), k, i, state)

    delivery = None if own.actuator is None else own.actuator.init(held)
    planner = Planner()
    numbers = planner.allocate(arrays)
    k, i = planner.view("k", WHOLE), planner.view("i", WHOLE)
    brakes, fresh = planner.view("brakes", jax.ShapeDtypeStruct((), bool)), planner.allocate(np.ones((), bool))
    planner.named("fresh", fresh)
    tau = planner.view("tau", np.asarray(held))
    vector = jax.ShapeDtypeStruct((start.q.shape[0],), float)
    memories = {}
    for name, tree in (("delivery", delivery), ("sensor", first), ("state", start)):
        memories[name] = planner.allocate(tree, name)
        memories[f"{name}_after"] = planner.allocate(tree, f"{name}_after")
    state = memories["state"]
    planner.named("q", state.q)
    planner.named("dq", state.dq)
    measured = [
        planner.view(f"measured_{name}", np.asarray(part))
        for name, part in (("q", measurement0.q), ("dq", measurement0.dq))
    ]
    set_tau = planner.view("set_tau", np.asarray(held))
    planner.region("measured", measured[0], set_tau)
    fields = {"set_tau": set_tau}
    fields |= {name: planner.view(name, WHOLE) for name in ("true_k", "applied", "missing", "braking")}
    fields["true_t"] = planner.allocate(NUMBER)
    fields |= {name: planner.allocate(vector) for name in ("true_q", "true_dq", "true_e")}
    fields["true_wake"] = planner.view("wake", NUMBER)
    truth = [fields[name] for name in ("true_t", "true_q", "true_dq", "true_e")]
    measurement = (measured, fresh, memories["sensor_after"], truth)
    planner.compile("measure", measure, (numbers, k, state, memories["sensor"]), measurement)
    drives = memories["delivery"]
    planner.compile("set", set_, (numbers, k, state, drives, tau, brakes), (set_tau, memories["delivery_after"]))
    force_slot = planner.view("force", vector)
    world = None
    if isinstance(plant, MujocoPlant):
        planner.compile("move", external_torque, (numbers, k, i, state, set_tau, drives), force_slot)
        world = _world(plant, float(period) / stepping.substeps, start, scenario.t1)
    else:
        planner.compile("move", move, (numbers, k, state, set_tau, drives), memories["state_after"])
    planner.region("row", set_tau, fields["true_wake"])
    return ArmPlan(
        plan=planner.plan(),
        row=dtype_of(fields, set_tau, fields["true_wake"]),
        world=world,
        substeps=stepping.substeps,
    )


def _first(sensor: AbstractSensor | None, state: State, period: Scalar, transport: int) -> tuple[Any, State]:
    """Return the sensor's memory before tick 0, and the measurement with which the loop starts.

    - `state`: the arm's state at that measurement.
    - `transport`: as in `arm_plan`.
    """
    if sensor is None:
        return (), state
    memory = sensor.init(state)
    if not transport:
        return memory, state
    measurement, memory = jax.jit(lambda s, m: sensor(jnp.zeros((), int), s, period, m))(state, memory)
    return memory, measurement.state


def _world(plant: MujocoPlant, timestep: float, start: State, until: float) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return MuJoCo's model, and the joints' position and velocity indices in it.

    Raises DefinitionError if the payload changes during the run, since the model is constant.
    """
    from slidax.simulation.mujoco_model import World

    load = plant.load
    if load is not None and float(load.payload.mass) > 0 and (load.attached > 0 or load.released < until):
        raise DefinitionError(
            "a payload that is attached or released during the run needs the built-in arm: `--arm own`"
        )
    world = World(plant, timestep, start)
    return world.model, world.positions, world.dofs
