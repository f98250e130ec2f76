"""Learn rotor inertia and Coulomb friction of each joint during the motion."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from slidax.core.errors import DefinitionError, short_repr
from slidax.core.parameter import parameter
from slidax.core.types import PerJoint, Scalar, State, Vector

from .adaptation import STAGES, AbstractAdaptation, Experience, LearnedParameters, filter_step, noise_of, settled_stages

FASTEST = 1e4
"""rad/s² or m/s²: largest credible acceleration; larger ones come from wrong measurements."""

STRONGEST = 1e6
"""N m or N: largest credible torque."""

STEADY = 1e-3
"""Share of `window` and `coulomb_window` that is added to the normal equations, so that they can always be solved."""


class Learning(eqx.Module):
    """Memory of `JointLearning`.

    The symbols φ, c, y, J and f are those of `JointLearning`.

    - `positions`: the last two measured positions, the newest first [2 n].
    - `tau`: torque of the period before the last measurement [n].
    - `elapsed`: time since the start or the last lost sample [s]; it stops once the band-pass has settled.
    - `begun`: True after the first sample.
    - `stages`: states of the band-pass, for torque, acceleration and direction of motion.
    - `information`: `∫φ²`, `∫φ c`, `∫c²` [3 n]: the information matrix of inertia and friction.
    - `rotor`, `coulomb`: estimates of J, kg m² or kg, and f, N m or N [n].
    - `squares`: recent means of φ², φ z and z² with z = y - f c, [3 n].
    """

    positions: Float[Array, "2 n"]
    tau: Vector
    elapsed: Scalar
    begun: Bool[Array, ""]
    stages: Float[Array, "5 3 n"]
    information: Float[Array, "3 n"]
    rotor: Vector
    coulomb: Vector
    squares: Float[Array, "3 n"]


class JointLearning(AbstractAdaptation):
    """Recursive least squares for each joint, with band-passed signals: `y = (M0_ii - J0 + J) φ + f c`.

    J and f are the estimated rotor inertia and Coulomb friction, M0 and J0 the nominal inertia matrix and rotor
    inertia. φ is the joint's acceleration, the second difference of its measured position, and `c = tanh(q̇/v_s)`. y is
    the torque less the nominal bias and the torque for the other joints' accelerations,
    `y = τ̄ - (C0 q̇ + G0) - Σ M0_ij φ_j`. τ̄ is the mean torque of the two periods that the second difference spans. y, φ
    and c pass the same band-pass from `low` to `high`.

    - The band contains the loop's crossover, since an error of the inertia harms the loop there. At lower frequencies
      unmodelled weight looks like negative inertia.
    - Old information is forgotten only when new information arrives, so that a long standstill forgets nothing: the
      information matrix is scaled back when it exceeds `window` or `coulomb_window`.
    - J is updated only if |φ| is above `gate`, a multiple of the encoder noise in the band: noise in φ would bias the
      inertia towards zero.
    - J is updated only while torque and acceleration are coherent: `φ z > 0` and `(φ z)² > coherence φ² z²` in means
      over `recent`, with `z = y - f c`. A torque that moves the joint is in phase with its acceleration. The weight of
      a payload that is taken up or released is not.
    - With the links' inertia `L = M0_ii - J0`, J stays in `[rotor_min - 0.6 L, rotor_max + L]`, and f in
      `[0, coulomb_max]`. M̂ is therefore positive definite and bounded for all measurements.

    Source: docs/learning.md. Recursive least squares: Ljung, System Identification, 1999; Åström and Wittenmark,
    Adaptive Control, 1995.
    """

    title = "Rotor inertia and Coulomb friction of each joint, learnt in the band of the loop's own crossover."

    rotor: PerJoint = parameter("J at the start", "kg m² or kg", ">= 0", default=0.0)
    coulomb: PerJoint = parameter("f at the start", "N m or N", "[0, coulomb_max]", default=0.0)
    rotor_min: PerJoint = parameter("least rotor inertia", "kg m² or kg", ">= 0", default=0.0)
    rotor_max: PerJoint = parameter("largest rotor inertia", "kg m² or kg", ">= rotor_min", default=10.0)
    coulomb_max: PerJoint = parameter("largest Coulomb friction; 0 to learn none", "N m or N", ">= 0", default=0.0)
    low: Scalar = parameter("lower end of the band", "rad/s", "> 0", default=15.0)
    high: Scalar = parameter("upper end of the band", "rad/s", "> low", default=200.0)
    gate: PerJoint = parameter(
        "least band-passed acceleration from which inertia is learnt", "rad/s² or m/s²", ">= 0", default=0.2
    )
    gate_direction: PerJoint = parameter("least band-passed |c| from which f is learnt", "", ">= 0", default=0.05)
    coherence: Scalar = parameter("least squared coherence from which inertia is learnt", "", "[0, 1)", default=0.8)
    recent: Scalar = parameter("averaging time of the coherence", "s", "> 0", default=0.015)
    prior: PerJoint = parameter(
        "∫φ² dt that the first guess of J counts for", "(rad/s²)² s or (m/s²)² s", "> 0", default=0.3
    )
    window: PerJoint = parameter(
        "largest ∫φ² dt that the estimate of J keeps", "(rad/s²)² s or (m/s²)² s", ">= prior", default=1.0
    )
    coulomb_prior: PerJoint = parameter("∫c² dt that the first guess of f counts for", "s", "> 0", default=0.02)
    coulomb_window: PerJoint = parameter(
        "largest ∫c² dt that the estimate of f keeps", "s", ">= coulomb_prior", default=0.5
    )

    def init(self, measured: State) -> Learning:
        nothing = jnp.zeros_like(measured.q)
        return Learning(
            positions=jnp.stack([measured.q, measured.q]),
            tau=nothing,
            elapsed=jnp.zeros((), nothing.dtype),
            begun=jnp.zeros((), bool),
            stages=jnp.zeros((STAGES, 3, *nothing.shape), nothing.dtype),
            information=jnp.stack([nothing + self.prior, nothing, nothing + self.coulomb_prior]),
            rotor=nothing + self.rotor,
            coulomb=nothing + self.coulomb,
            squares=jnp.zeros((3, *nothing.shape), nothing.dtype),
        )

    def learnt(self, memory: Learning) -> LearnedParameters:
        return LearnedParameters(rotor=memory.rotor, coulomb=memory.coulomb)

    def __call__(self, experience: Experience, memory: Learning) -> Learning:
        """Return the memory after a sample.

        After a gap the filter continues once a second difference is complete again. Nothing is learnt until it has
        settled, since sudden position noise looks like a jump of the velocity.
        """
        h, mass = experience.period, experience.mass
        newest, before = memory.positions
        ddq = jnp.clip((experience.q - 2.0 * newest + before) / (h * h), -FASTEST, FASTEST)
        others = jnp.sum(jnp.where(jnp.eye(ddq.size, dtype=bool), 0.0, mass) * ddq[None, :], axis=1)
        torque = 0.5 * (experience.tau + memory.tau) - experience.bias
        direction = jnp.tanh(experience.dq / self.smoothing)
        signals = jnp.stack([jnp.clip(torque - others, -STRONGEST, STRONGEST), ddq, direction])

        settled = self.recent + 2.0 * h
        elapsed = jnp.where(experience.missed, 0.0, jnp.minimum(memory.elapsed + h, settled + h))
        period_ended = elapsed > 2.5 * h
        # Assumption at the first sample: the arm has been at rest under a constant torque for a long time.
        held = jnp.stack([jnp.clip(torque, -STRONGEST, STRONGEST), jnp.zeros_like(ddq), direction])
        stages = jnp.where(memory.begun, memory.stages, settled_stages(held))
        stages = jnp.where(period_ended, filter_step(stages, signals, self.low, self.high, h), stages)
        return self._regressed(experience, memory, stages, jnp.where(elapsed > settled, h, 0.0), elapsed)

    def _regressed(
        self, experience: Experience, memory: Learning, stages: Float[Array, "5 3 n"], weight: Scalar, elapsed: Scalar
    ) -> Learning:
        """The memory after one step of least squares with the filtered signals; weight 0 s teaches nothing."""
        y, phi, c = stages[-1]
        links = jnp.diagonal(experience.mass) - self.counted
        missed = y - (links + memory.rotor) * phi - memory.coulomb * c
        rubbed = y - memory.coulomb * c
        newer = -jnp.expm1(-weight / self.recent)
        squares = memory.squares + newer * (jnp.stack([phi * phi, phi * rubbed, rubbed * rubbed]) - memory.squares)
        coherent = squares[1] * jnp.abs(squares[1]) > self.coherence * squares[0] * squares[2]
        taught = jnp.where(coherent & (jnp.abs(phi) > self.gate), phi, 0.0)
        turned = jnp.where((jnp.abs(c) > self.gate_direction) & (self.coulomb_max > 0.0), c, 0.0)
        of_rotor, of_both, of_coulomb = memory.information + weight * jnp.stack(
            [taught * taught, taught * turned, turned * turned]
        )
        a, b = of_rotor + STEADY * self.window, of_coulomb + STEADY * self.coulomb_window
        gain = weight * missed / (a * b - of_both * of_both)
        rotor = memory.rotor + gain * (b * taught - of_both * turned)
        coulomb = memory.coulomb + gain * (a * turned - of_both * taught)
        # Scaled from both sides, the matrix stays semidefinite and its estimate does not move.
        keep_rotor = jnp.minimum(1.0, jnp.sqrt(self.window / of_rotor))
        keep_coulomb = jnp.minimum(1.0, jnp.sqrt(self.coulomb_window / of_coulomb))
        return Learning(
            positions=jnp.stack([experience.q, memory.positions[0]]),
            tau=experience.tau,
            elapsed=elapsed,
            begun=jnp.ones((), bool),
            stages=stages,
            information=jnp.stack(
                [of_rotor * keep_rotor**2, of_both * keep_rotor * keep_coulomb, of_coulomb * keep_coulomb**2]
            ),
            rotor=jnp.clip(rotor, self.rotor_min - 0.6 * links, self.rotor_max + links),
            coulomb=jnp.clip(coulomb, 0.0, self.coulomb_max),
            squares=squares,
        )

    @classmethod
    def of_arm(
        cls, mass: Any, *, rotors: Any, torque: Any, deviation: Any, period: float, **parameters: Any
    ) -> JointLearning:
        """Return the adaptation for an arm, its drives and its encoders.

        For a joint with J0 = 0 the first guess of J is 0.002 kg m² for each N m of rated torque (docs/learning.md). The
        limits of J are 0.0005 and 0.1 kg m² for each N m. With `rotors=None` the first guess and the lower limit are 0.
        f is at most 0.1 times the rated torque. The upper end of the band is 200 rad/s, or as low as 120 rad/s if three
        times the encoder noise would exceed 0.2 rad/s². `gate` is three times this noise, at least 0.2 rad/s².

        - `mass`: inertia matrix of the nominal arm at a working posture [n n].
        - `rotors`: J0, the model's rotor inertia, one number or [n], kg m² or kg; None for a model without rotors.
        - `torque`: rated torque of each joint, one number or [n], N m or N. For inf, the torque that accelerates the
          joint's own inertia by 25 rad/s² is used.
        - `deviation`: standard deviation of a measured position, one number or [n], rad or m.
        - `period`: h [s].
        - `parameters`: parameters that replace the computed ones.

        Raises DefinitionError if an argument or a parameter is out of its range.
        """
        inertia = np.diagonal(np.asarray(mass, float))
        counted = np.broadcast_to(np.asarray(0.0 if rotors is None else rotors, float), inertia.shape)
        rated = np.broadcast_to(np.asarray(torque, float), inertia.shape)
        if not (rated > 0.0).all():
            raise DefinitionError(
                f"the rated torque must be > 0 N m or N, and inf where it is not known; got {short_repr(torque)}"
            )
        noise = np.asarray(deviation, float)
        if not (np.isfinite(noise) & (noise >= 0.0)).all():
            raise DefinitionError(
                f"the standard deviation of a measured position must be finite and >= 0 rad or m; "
                f"got {short_repr(deviation)}"
            )
        rated = np.where(np.isfinite(rated), rated, USUAL_ACCELERATION * inertia)
        worst = float(np.max(deviation))
        low, high = float(parameters.get("low", 15.0)), 200.0
        while high > 120.0 and CLEAR * noise_of(worst, low, high, period) > GATE:
            high -= 5.0
        high = float(parameters.get("high", high))
        computed = {
            "counted": counted,
            "rotor": counted if rotors is None else np.where(counted > 0.0, counted, GUESS * rated),
            "rotor_min": np.zeros_like(rated) if rotors is None else LEAST * rated,
            "rotor_max": LARGEST * rated,
            "coulomb_max": 0.1 * rated,
            "high": high,
            "gate": max(GATE, CLEAR * noise_of(worst, low, high, period)),
        }
        return cls(**{**computed, **{name: value for name, value in parameters.items() if value is not None}})


GATE = 0.2
"""rad/s²: `gate` for encoders with a resolution of 1e-5 rad or finer."""

CLEAR = 3.0
"""`gate` over the standard deviation of the encoder noise in the band."""

GUESS, LEAST, LARGEST = 0.002, 0.0005, 0.1
"""Rotor inertia for each N m of rated torque [kg m²]: the first guess, the least and the largest."""

USUAL_ACCELERATION = 25.0
"""rad/s²: acceleration of a joint under its rated torque, if that torque is not known."""
