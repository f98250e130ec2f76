"""A scenario's arm, sensor and drives as machine code: the robot's side of one tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax._types import Scalar, State, Vector
from slidax.realtime import Plan
from slidax.sensors import AbstractSensor, Delayed, Lossy
from slidax.simulation import BANDS, MujocoPlant, Plant
from slidax.simulation.define import define_loop
from slidax.simulation.loop import Loop
from slidax.simulation.period import HeldTorque, force, moved

from .law_plan import NUMBER, WHOLE, dtype_of, require_samples
from .planner import Planner, kernel

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

BRAKES_IN = 0.05
"""Time constant of the brakes [s]."""


@dataclass(frozen=True)
class ArmPlan:
    """An arm, ready to be moved tick by tick.

    - `plan`: its code and memory.
    - `row`: the dtype of a row.
    - `world`: MuJoCo's model and the joints' indices in it; None for slidax's own arm.
    - `substeps`: MuJoCo's steps in a tick.
    """

    plan: Plan
    row: np.dtype[Any]
    world: tuple[Any, np.ndarray, np.ndarray] | None
    substeps: int

    def columns(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of rows (bytes, [m length]), by their names in a log."""
        table = np.ascontiguousarray(rows).view(self.row)[:, 0] if len(rows) else np.zeros(0, self.row)
        return {name: table[name] for name in self.row.names or ()}


def sooner(sensor: AbstractSensor | None) -> AbstractSensor:
    """The sensor with one period less delay, for a loop that takes one period to transport a measurement.

    Raises DefinitionError if its measurements are less than one period old.
    """
    if isinstance(sensor, Lossy):
        return eqx.tree_at(lambda lossy: lossy.sensor, sensor, sooner(sensor.sensor))
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
    """Compile a scenario's arm.

    - `transport`: periods from a measurement to its torque, 0 or 1. With 1 the sensor has one period less delay, and
      the first measurement is that of the tick before the first.

    Raises DefinitionError if the scenario is not in held mode or does not allow it, or llvmlite is not installed.
    """
    require_samples(scenario)
    plant = scenario.plant
    own = plant.with_friction if isinstance(plant, MujocoPlant) else plant
    stepping = scenario.stepping
    loop, _ = define_loop(
        own, scenario.controller, scenario.trajectory, scenario.state0, scenario.t1, stepping, None, BANDS
    )
    sensor = sooner(own.sensor) if transport else own.sensor
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
        # Brakes also hold an unknown payload.
        robot = plant.at(k.astype(float) * period)
        stopping = robot.bias(state.q, state.dq) - robot.mass(state.q) @ state.dq / BRAKES_IN
        tau = jnp.where(brakes, stopping, tau)
        if plant.actuator is None:
            return tau, delivery
        return plant.actuator.set(tau, period, delivery)

    def loop_of(arrays: Any) -> Loop:
        plant, trajectory, period = parts(arrays)
        return eqx.tree_at(lambda loop: (loop.plant, loop.trajectory, loop.period), loop, (plant, trajectory, period))

    def move(arrays: Any, k: Any, state: State, tau: Vector, delivery: Any) -> State:
        current = loop_of(arrays)
        return moved(current, state, k.astype(float) * current.period, HeldTorque(tau, delivery))

    def push(arrays: Any, k: Any, i: Any, state: State, tau: Vector, delivery: Any) -> Vector:
        return force(loop_of(arrays), HeldTorque(tau, delivery), k, i, state)

    delivery = None if own.actuator is None else own.actuator.init(held)
    planner = Planner()
    numbers = planner.place(arrays)
    k, i = planner.view("k", WHOLE), planner.view("i", WHOLE)
    brakes, fresh = planner.view("brakes", jax.ShapeDtypeStruct((), bool)), planner.place(np.ones((), bool))
    planner.named("fresh", fresh)
    tau = planner.view("tau", np.asarray(held))
    vector = jax.ShapeDtypeStruct((start.q.shape[0],), float)
    memories = {}
    for name, tree in (("delivery", delivery), ("sensor", first), ("state", start)):
        memories[name] = planner.place(tree, name)
        memories[f"{name}_after"] = planner.place(tree, f"{name}_after")
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
    fields["true_t"] = planner.place(NUMBER)
    fields |= {name: planner.place(vector) for name in ("true_q", "true_dq", "true_e")}
    fields["true_wake"] = planner.view("wake", NUMBER)
    shapes = (jax.tree.map(_shape, part) for part in (arrays, start, first, delivery))
    of_loop, of_state, of_sensor, of_delivery = shapes
    flag = jax.ShapeDtypeStruct((), bool)
    code, _ = kernel(measure, of_loop, WHOLE, of_state, of_sensor)
    truth = (fields["true_t"], *(fields[name] for name in ("true_q", "true_dq", "true_e")))
    planner.code(
        "measure",
        code,
        (numbers, k, state, memories["sensor"]),
        (measured, fresh, memories["sensor_after"], truth),
    )
    code, _ = kernel(set_, of_loop, WHOLE, of_state, of_delivery, vector, flag)
    planner.code(
        "set",
        code,
        (numbers, k, state, memories["delivery"], tau, brakes),
        (set_tau, memories["delivery_after"]),
    )
    force_slot = planner.view("force", vector)
    world = None
    if isinstance(arrays, MujocoPlant):
        code, _ = kernel(push, of_loop, WHOLE, WHOLE, of_state, vector, of_delivery)
        planner.code("move", code, (numbers, k, i, state, set_tau, memories["delivery"]), force_slot)
        world = _world(arrays, float(period) / stepping.substeps, start, scenario.t1)
    else:
        code, _ = kernel(move, of_loop, WHOLE, of_state, vector, of_delivery)
        planner.code("move", code, (numbers, k, state, set_tau, memories["delivery"]), memories["state_after"])
    planner.region("row", set_tau, fields["true_wake"])
    return ArmPlan(
        plan=planner.plan(),
        row=dtype_of(fields, set_tau, fields["true_wake"]),
        world=world,
        substeps=stepping.substeps,
    )


def _first(sensor: AbstractSensor | None, state: State, period: Scalar, transport: int) -> tuple[Any, State]:
    """The sensor's memory after the measurement before the first tick, and that measurement."""
    if sensor is None:
        return (), state
    memory = sensor.init(state)
    if not transport:
        return memory, state
    measurement, memory = jax.jit(lambda s, m: sensor(jnp.zeros((), int), s, period, m))(state, memory)
    return memory, measurement.state


def _world(plant: MujocoPlant, timestep: float, start: State, until: float) -> tuple[Any, np.ndarray, np.ndarray]:
    """MuJoCo's model, constant during the run."""
    from slidax.simulation.mujoco.world import World

    load = plant.load
    if load is not None and float(load.payload.mass) > 0 and (load.attached > 0 or load.released < until):
        raise DefinitionError(
            "a payload that is attached or released during the run needs the built-in arm: `--arm own`"
        )
    world = World(plant, timestep, start)
    return world.model, world.places, world.dofs


def _shape(x: Any) -> Any:
    return jax.ShapeDtypeStruct(np.shape(x), x.dtype)
