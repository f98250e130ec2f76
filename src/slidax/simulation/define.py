"""Definition of a closed loop from its parts, with checks that they fit each other."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from slidax.codegen.trace.tracing import located_tracing_errors
from slidax.core.errors import DefinitionError, as_array, count_noun, each_of, is_traced, require_joints
from slidax.core.integrators import semi_implicit_euler
from slidax.core.joint_names import joint_label, quote_names
from slidax.core.tracing import require_64_bits
from slidax.core.types import Envelope, Reference, State
from slidax.law.controllers import AbstractController
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.sampled.controller import SampledData
from slidax.law.sound import require_sound_law
from slidax.motions.trajectory import AbstractMotion

from .loop import ClosedLoop, begin, sample
from .plant import MujocoPlant, Plant, rotors_of
from .states import require_within_limits, states_of
from .stepping import Stepping
from .tally import Windows

MOST_SAMPLES = 10**9
"""Largest number of samples in a run: some hours of computing with a simple law."""


def define_loop(
    plant: Plant,
    controller: AbstractController,
    trajectory: AbstractMotion,
    state0: State,
    t1: float,
    stepping: Stepping,
    log_every: int | None,
    bands: tuple[float, ...],
    tolerance: PrescribedPerformance | None = None,
) -> tuple[ClosedLoop, int]:
    """Return the closed loop and the number of its samples. Arguments as in `simulate`.

    Traced values are not checked, except for their shapes.

    Raises DefinitionError if the parts do not fit each other.
    """
    require_64_bits()
    if log_every is not None and not 1 <= log_every <= MOST_SAMPLES:
        raise DefinitionError(f"`log_every` must be in [1, {MOST_SAMPLES:.0e}], or None for no log; got {log_every}")
    require_fitting(plant, controller, trajectory, state0, tolerance, stepping=stepping)
    require_sound_law(controller)
    steps = _steps(float(t1), stepping.period)
    require_within_limits(plant.robot, trajectory, state0, steps, stepping)
    require_transmission(plant, state0, stepping)
    loop = ClosedLoop(
        plant=plant,
        controller=controller,
        trajectory=trajectory,
        period=constant(stepping.period),
        last=constant(steps),
        windows=windows_of(steps, stepping.period, bands),
        integrator=stepping.integrator,
        substeps=stepping.substeps,
        continuous=stepping.mode == "continuous",
        recover=stepping.outside == "recover",
        tolerance=tolerance,
    )
    return loop, steps + 1


def require_fitting(
    plant: Plant | MujocoPlant,
    controller: AbstractController,
    trajectory: AbstractMotion,
    state0: State,
    tolerance: PrescribedPerformance | None = None,
    *,
    stepping: Stepping,
) -> None:
    """Raise a DefinitionError if the parts of a closed loop do not fit each other. Arguments as in `simulate`."""
    n = plant.robot.joints
    if controller.joints != n:
        raise DefinitionError(
            f"the controller commands {count_noun(controller.joints, 'joint')}, but the plant has {n}"
        )
    for name, value in (("q", state0.q), ("dq", state0.dq)):
        if value.shape != (n,):
            raise DefinitionError(f"`state0.{name}` must have one entry for {each_of(n, 'joint')}; got {value.shape}")
        if not is_traced(value) and not np.isfinite(value).all():
            joint = joint_label(plant.robot.joint_names[int(np.argmin(np.isfinite(value)))])
            raise DefinitionError(f"`state0.{name}` must be finite; it is not for {joint}")
    shape = eqx.filter_eval_shape(trajectory.position, jax.ShapeDtypeStruct((), float)).shape
    if shape != (n,):
        raise DefinitionError(
            f"the trajectory gives {list(shape)} positions, but the plant has {count_noun(n, 'joint')}"
        )
    names = getattr(trajectory, "joint_names", ())
    if names != plant.robot.joint_names and set(names) == set(plant.robot.joint_names):
        raise DefinitionError(
            f"the trajectory's joints are {quote_names(names)}, but the robot's order is "
            f"{quote_names(plant.robot.joint_names)}: read the motion with `joints=robot.joint_names`"
        )
    if tolerance is not None:
        require_joints(tolerance, n, "the plant")
    try:
        forces = eqx.filter_eval_shape(plant.disturbance, jax.ShapeDtypeStruct((), float), state0).shape
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"the disturbance does not fit the plant's {count_noun(n, 'joint')}: {error}") from error
    if forces != (n,):
        raise DefinitionError(
            f"the disturbance gives {list(forces)} forces, but the plant has {count_noun(n, 'joint')}"
        )
    if stepping.mode == "continuous":
        if isinstance(controller, SampledData):
            raise DefinitionError("a sampled-data law needs samples: simulate in held mode, not in continuous mode")
        for name, part in (("a sensor", plant.sensor), ("an actuator", plant.actuator)):
            if part is not None:
                raise DefinitionError(f"{name} needs samples: simulate in held mode, not in continuous mode")
    if isinstance(controller, SampledData) and not is_traced(controller.period):
        period = float(controller.period)
        if abs(period - stepping.period) > 1e-9 * period:
            raise DefinitionError(
                f"the sampled-data law is designed for a period of {period:g} s; it cannot be sampled every "
                f"{stepping.period:g} s"
            )


SLOW_ENOUGH = 1.0
"""Largest ω h of an elastic joint: ω is its angular frequency, h the step. The integrator is stable up to 2; at 1 the
simulated frequency is 5 % too high."""


def require_transmission(plant: Plant | MujocoPlant, state0: State, stepping: Stepping) -> None:
    """Raise a DefinitionError if a plant's transmission does not fit its arm and the time steps.

    Traced values are not checked, except for their shapes.
    """
    transmission = getattr(plant, "transmission", None)
    if transmission is None:
        return
    n = plant.robot.joints
    require_joints(transmission, n, "the plant")
    if stepping.mode == "continuous" or stepping.integrator is not semi_implicit_euler:
        raise DefinitionError(
            "LuGre friction and elastic joints need `simulation.mode: held` and `simulation.integrator: "
            "semi_implicit_euler`: set both"
        )
    if transmission.elasticity is None or is_traced((transmission, plant.robot, state0)):
        return
    rotors = rotors_of(plant.robot)
    if transmission.elasticity.inertia is None and not (np.asarray(rotors) > 0.0).all():
        joint = joint_label(plant.robot.joint_names[int(np.argmin(np.asarray(rotors)))])
        raise DefinitionError(f"the motor of {joint} has no inertia: set `transmission.elasticity.inertia` > 0 kg m²")
    mode = transmission.fastest_mode(states_of(plant.robot, np.asarray(state0.q)[None]).mass[0], rotors)
    step = stepping.period / stepping.substeps
    if not mode * step <= SLOW_ENOUGH:
        raise DefinitionError(
            f"an elastic joint oscillates at {mode / (2.0 * np.pi):.4g} Hz, too fast for steps of {step:g} s: set "
            f"`simulation.substeps` to at least {math.ceil(stepping.period * mode / SLOW_ENOUGH)}"
        )


def windows_of(steps: int, period: float, bands: tuple[float, ...]) -> Windows:
    """Return the first samples of the statistics' time windows, and the settling bands.

    - `steps`: number of periods of the run.
    - `period`: time between samples [s].
    - `bands`: error bands for the settling time, rad or m.
    """
    return Windows(
        steady=constant(int(np.ceil(0.75 * steps))),
        late=constant(int(np.floor(2.0 / period + 1e-6)) + 1),
        bands=constant(np.asarray(bands, float)),
    )


def constant(number: Any) -> Array:
    """Convert a known value to a JAX array; `jnp.asarray` would compile a program for it."""
    return jax.device_put(np.asarray(number))


def _steps(t1: float, period: float) -> int:
    if not (np.isfinite(t1) and t1 > 0):
        raise DefinitionError(f"`t1` must be > 0 s; got {t1:g}")
    if t1 / period > MOST_SAMPLES:
        raise DefinitionError(
            f"`t1` must be at most {MOST_SAMPLES:.0e} periods of {period:g} s, hours of computing; "
            f"got {t1 / period:.3g}"
        )
    steps = round(t1 / period)
    if steps < 1 or abs(steps * period - t1) > 1e-6 * period * max(1.0, 1e-3 * steps):
        raise DefinitionError(f"`t1` must be a whole number of periods of {period:g} s; got {t1:g} s")
    return steps


def require_start(loop: ClosedLoop, state0: State, envelope: Envelope | None, reference: Reference, held: Any) -> None:
    """Raise a DefinitionError if the initial error is not inside its bounds, or the actuator cannot hold the arm.

    - `envelope`, `reference`: the control law's envelope, None without one, and the reference, both at t = 0.
    - `held`: torque that holds the arm at `state0` [n], N m or N; None without an actuator.
    """
    names = [joint_label(name) for name in loop.plant.robot.joint_names]
    if loop.plant.actuator is not None and held is not None:
        robot = loop.plant.robot
        needed, limit = (
            np.asarray(loop.plant.actuator.command(as_array(held))),
            np.broadcast_to(loop.plant.actuator.limits.torque, held.shape),
        )
        weak = np.abs(needed) > limit
        if weak.any():
            joint = int(np.argmax(weak))
            unit = robot.torque_units[joint]
            raise DefinitionError(
                f"`TorqueLimits.torque` must hold the arm in its initial posture: {names[joint]} needs "
                f"{needed[joint]:.4g} {unit} there, but its limit is {limit[joint]:g} {unit}; raise it, or start "
                "in a posture that needs less"
            )
    e = np.asarray(state0.q - reference.q)
    if loop.tolerance is not None:
        band = loop.tolerance.envelope(constant(0.0), loop.tolerance.init(constant(0.0), state0.q - reference.q))
        outside = (e <= np.asarray(band.lower)) | (np.asarray(band.upper) <= e)
        if outside.any():
            joint = int(np.argmax(outside))
            raise DefinitionError(
                f"the initial error must be inside the tolerance band, |e(0)| < rho0; got e(0) = {e[joint]:.4g} for "
                f"{names[joint]}; enlarge the band's initial radius or start nearer"
            )
    if envelope is None or loop.recover:
        return
    lower, upper = np.asarray(envelope.lower), np.asarray(envelope.upper)
    outside = ~((lower < e) & (e < upper))
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`state0.q` must start inside the envelope, lower < e(0) < upper (eq. 12), so |e(0)| < rho0 (eq. 20); "
            f"got e(0) = {e[joint]:.4g} for {names[joint]}, whose bounds are {lower[joint]:.4g} and "
            f"{upper[joint]:.4g}; enlarge the initial radius or start nearer"
        )


MOST_BYTES = 10**9
"""Size limit of a log [bytes]; building the log takes twice as much memory."""

SMALL = 200_000
"""Number of rows of a log up to which its size is not checked."""


def require_log_fits(loop: ClosedLoop, state0: State, rows: int) -> None:
    """Raise a DefinitionError if a log with this number of rows would exceed `MOST_BYTES`."""
    if rows <= SMALL:
        return
    with located_tracing_errors():
        line = eqx.filter_eval_shape(lambda: sample(loop, begin(loop, state0)[0])[1])
    size = rows * sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(line))
    if size > MOST_BYTES:
        raise DefinitionError(
            f"the log of {rows} samples would take {size / 1e9:.3g} GB; the limit is {MOST_BYTES / 1e9:g} GB: "
            f"make `log_every` {math.ceil(size / MOST_BYTES)} times as large, or log nothing with `log_every=None`"
        )
