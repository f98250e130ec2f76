"""Transmissions with states of their own: LuGre friction and elastic joints."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax.core.errors import DefinitionError
from slidax.core.linear_algebra import solve_symmetric
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Matrix, PerJoint, Scalar, State, Vector


class LuGre(AbstractPart):
    """`F = σ₀ z + σ₁ ż + σ₂ v`, `ż = v - σ₀ |v| z/g(v)`, `g(v) = F_c + (F_s - F_c) exp(-(v/v_s)²)`.

    F is the friction force at the velocity v, z the mean deflection of the bristles between two surfaces. Below the
    static friction F_s a joint sticks and gives way by F/σ₀, like a spring. In steady sliding `F = g(v) sgn v + σ₂ v`,
    the Stribeck curve.

    Source: Canudas de Wit, Olsson, Åström and Lischinsky, A new model for control of systems with friction, IEEE TAC
    1995.
    """

    coulomb: PerJoint = parameter("F_c, Coulomb friction", "N m or N", "> 0")
    static: PerJoint = parameter("F_s, static friction", "N m or N", ">= coulomb")
    stribeck_velocity: PerJoint = parameter("v_s, Stribeck velocity", "rad/s or m/s", "> 0", default=0.05)
    stiffness: PerJoint = parameter("σ₀, stiffness of the bristles", "N m/rad or N/m", "> 0", default=1e4)
    damping: PerJoint = parameter("σ₁, damping of the bristles", "N m s/rad or N s/m", ">= 0", default=30.0)
    viscous: PerJoint = parameter("σ₂, viscous friction", "N m s/rad or N s/m", ">= 0", default=0.0)

    def level(self, velocity: Vector) -> Vector:
        """Return `g(v)`, the friction in steady sliding without its viscous part [n], N m or N."""
        return self.coulomb + (self.static - self.coulomb) * jnp.exp(-((velocity / self.stribeck_velocity) ** 2))

    def deflection(self, bristle: Vector, velocity: Vector, after: Vector, h: Scalar) -> Vector:
        """Return the bristles' deflection after a step, `z⁺ = (z + h v⁺)/(1 + h σ₀ |v|/g(v))` [n], rad or m.

        The decay is implicit, and so stable for any step and stiffness. Its rate `σ₀ |v|/g(v)` is that at the step's
        start.

        - `bristle`: z at the start of the step [n], rad or m.
        - `velocity`, `after`: v at the step's start, and v⁺ at its end [n], rad/s or m/s.
        - `h`: step [s].
        """
        return (bristle + h * after) / (1.0 + h * self.stiffness * jnp.abs(velocity) / self.level(velocity))

    def force(self, bristle: Vector, velocity: Vector, h: Scalar) -> tuple[Vector, Vector]:
        """Return F0 and D of the friction `F = F0 + D (v⁺ - v)` in a step, with the velocity v⁺ at its end, [n] each.

        `F = σ₀ z⁺ + σ₁ (z⁺ - z)/h + σ₂ v⁺` is linear in v⁺, so that a step solves linear equations only.

        - `bristle`, `velocity`: z and v at the start of the step [n], rad and rad/s (m and m/s for a prismatic joint).
        - `h`: step [s].
        """
        after = self.deflection(bristle, velocity, velocity, h)
        kept = 1.0 + h * self.stiffness * jnp.abs(velocity) / self.level(velocity)
        force = self.stiffness * after + self.damping * (after - bristle) / h + self.viscous * velocity
        return force, (self.stiffness * h + self.damping) / kept + self.viscous


class Elasticity(AbstractPart):
    """A spring between motor and link: `J θ̈ = τ - s - F`, `M q̈ + C q̇ + G = s + τ_d`, `s = k (θ - q) + d (θ̇ - q̇)`.

    s is the force of the spring, F the joint's friction, θ the motor's position behind the gear. The rotor and all
    friction are on the motor's side, so M is without rotor inertia. The motor's angular momentum counts about its own
    axis only.

    Source: Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. Meas. Control 1987.
    """

    stiffness: PerJoint = parameter("k, stiffness of the joint", "N m/rad or N/m", "> 0")
    inertia: PerJoint | None = parameter(
        "J, the motor's inertia behind the gear; by default the arm's rotor inertia", "kg m² or kg", "> 0", default=None
    )
    damping: PerJoint = parameter("d, damping of the joint", "N m s/rad or N s/m", ">= 0", default=0.0)
    encoder: Literal["motor", "link"] = piece(
        'side that the sensors measure: "motor" or "link"', default="motor", static=True
    )

    def __check_init__(self) -> None:
        if self.encoder not in ("motor", "link"):
            raise DefinitionError(f"`Elasticity.encoder` must be `motor` or `link`; got {self.encoder!r}")

    def motor(self, rotors: Vector) -> PerJoint:
        """Return the motors' inertia J: `inertia`, or the arm's rotor inertias `rotors` [n] by default."""
        return rotors if self.inertia is None else self.inertia


class TransmissionState(eqx.Module):
    """State of a transmission.

    - `bristle`: deflection z of LuGre friction [n], rad or m; None without this friction.
    - `motor`: positions and velocities of the motors; None without elasticity.
    """

    bristle: Vector | None
    motor: State | None


class Load(NamedTuple):
    """Inertia of the arm and the forces on it, at the start of a transmission's step.

    - `mass`: inertia matrix M(q), with the rotors [n n].
    - `rotors`: inertias of the rotors, which the diagonal of `mass` contains [n], kg m² or kg.
    - `force`: `τ_d - C q̇ - G` [n], N m or N.
    - `friction`: function that returns the arm's own friction from a velocity, both [n].
    """

    mass: Matrix
    rotors: Vector
    force: Vector
    friction: Callable[[Vector], Vector]


class Transmission(AbstractPart):
    """LuGre friction and elasticity of the simulated joints, with their own states (`TransmissionState`).

    One step of length h is linearly implicit: `q̇⁺` solves `(M + h B) (q̇⁺ - q̇) = h f`, where f is the force on the
    joints and the diagonal B has the damping of friction and springs; then `q⁺ = q + h q̇⁺`. M contains the rotors only
    if the joints are rigid; elastic joints have an equation for each motor in addition. LuGre friction is stable
    at any step. Springs take the positions at the step's start, so that the integration does not damp them; they limit
    the step (`fastest_mode`). Without friction and elasticity, the step would be `semi_implicit_euler`.
    """

    friction: LuGre | None = piece("LuGre friction; None if there is none", default=None)
    elasticity: Elasticity | None = piece("elasticity of the joints; None for rigid ones", default=None)

    def __check_init__(self) -> None:
        if self.friction is None and self.elasticity is None:
            raise DefinitionError("`Transmission` must have `friction`, `elasticity` or both: add one, or leave it out")

    def begin(self, state: State, held: Vector) -> TransmissionState:
        """Return the transmission's state at the start, with its springs in equilibrium.

        - `state`: positions and velocities of the arm.
        - `held`: torque that holds the arm in this position [n], N m or N.
        """
        elastic = self.elasticity
        motor = None if elastic is None else State(q=state.q + held / elastic.stiffness, dq=state.dq)
        return TransmissionState(None if self.friction is None else jnp.zeros_like(state.q), motor)

    def measured(self, state: State, own: TransmissionState) -> State:
        """Return the state that sensors measure: that of the motors or of the links, as `Elasticity.encoder` selects.

        - `state`, `own`: states of the arm and of the transmission.
        """
        if own.motor is None or self.elasticity is None or self.elasticity.encoder == "link":
            return state
        return own.motor

    def step(
        self, state: State, own: TransmissionState, tau: Vector, load: Load, h: Scalar
    ) -> tuple[State, TransmissionState]:
        """Return the states of the arm and of the transmission after a step under a constant torque.

        - `state`, `own`: states of the arm and of the transmission at the start of the step.
        - `tau`: torque of the drives [n], N m or N.
        - `load`: inertia and forces at the start of the step.
        - `h`: step [s].
        """
        moving = state if own.motor is None else own.motor
        force, damping = load.friction(moving.dq), jnp.zeros_like(moving.dq)
        if self.friction is not None and own.bristle is not None:
            own_force, damping = self.friction.force(own.bristle, moving.dq, h)
            force = force + own_force
        motor = None
        if self.elasticity is None or own.motor is None:
            slope = _solve(load.mass, h * damping, load.force + tau - force)
            after = _moved(state, state.dq + h * slope, h)
            moved = after
        else:
            spring = self.elasticity.stiffness * (own.motor.q - state.q)
            d, inertia = self.elasticity.damping, self.elasticity.motor(load.rotors) / h + damping
            # The motor's velocity after the step is (pushed + d q̇⁺)/(inertia + d).
            pushed = inertia * own.motor.dq + tau - spring - force
            share = d / (inertia + d)
            held = share * inertia
            slope = _solve(load.mass, h * held - load.rotors, load.force + spring + share * pushed - held * state.dq)
            after = _moved(state, state.dq + h * slope, h)
            motor = moved = _moved(own.motor, (pushed + d * after.dq) / (inertia + d), h)
        bristle = own.bristle
        if self.friction is not None and bristle is not None:
            bristle = self.friction.deflection(bristle, moving.dq, moved.dq, h)
        return after, TransmissionState(bristle, motor)

    def fastest_mode(self, mass: np.ndarray, rotors: Vector) -> float:
        """Return the largest natural frequency ω of the elastic joints, rad/s; 0 for rigid joints.

        `ω²` is the largest eigenvalue of `K ((M - R)⁻¹ + J⁻¹)`, with K, R and J the diagonal matrices of stiffness,
        rotor inertia in M, and motor inertia.

        - `mass`: inertia matrix M(q), with the rotors [n n].
        - `rotors`: inertias of the rotors, which the diagonal of `mass` contains [n], kg m² or kg.
        """
        if self.elasticity is None:
            return 0.0
        joints = len(mass)
        motor = np.broadcast_to(np.asarray(self.elasticity.motor(rotors)), joints)
        root = np.sqrt(np.broadcast_to(np.asarray(self.elasticity.stiffness), joints))
        inverse = np.linalg.inv(mass - np.diag(np.asarray(rotors))) + np.diag(1.0 / motor)
        return float(np.sqrt(np.linalg.eigvalsh(root[:, None] * inverse * root).max()))


def _solve(mass: Matrix, more: Vector, force: Vector) -> Vector:
    """Solve `(M + diag(more)) x = force`."""
    return solve_symmetric(mass + jnp.where(np.eye(force.size, dtype=bool), more, 0.0), force)


def _moved(state: State, dq: Vector, h: Scalar) -> State:
    """Return the state after a step with a new velocity."""
    return State(q=state.q + h * dq, dq=dq)
