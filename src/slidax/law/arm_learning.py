"""Estimate the arm's payload, link masses, friction and rotors during the motion, by regression over time windows."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from slidax.arms.adjusted import PAYLOAD, inertial_regressor
from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.pseudo_inertia import least_eigenvalue, nearest_body
from slidax.core.parameter import parameter, piece
from slidax.core.types import Matrix, PerJoint, Scalar, State, Vector

from .adaptation import AbstractAdaptation, Believed, Experience, LearnedParameters
from .arm_model import (
    ArmParameters,
    KnownArm,
    Rippled,
    TorqueShapes,
    arm_with,
    articulated,
    coupled_inertia,
    friction_shapes,
    link_body,
    parameter_count,
)
from .joint_learning import JointLearning, Learning
from .least_squares import (
    KINDS,
    NOISE,
    QUARTERS,
    Equations,
    Estimates,
    Window,
    diagonal_covariance,
    measured_once,
    moved_along,
    next_windows,
    quadratic_form,
    standard_deviations,
    window_noise,
    window_sums,
    with_drift,
)
from .model_trust import LEAST_LOST, Trust, judge, lost_payload

UPDATE_TIME = 0.01
"""s: time between two windows."""

FEWEST = 3
"""Least number of samples between two windows: for the least squares, the decision and the next window."""

BUSY = 2
"""Number of samples after a window that share its least-squares updates; few, so that most samples have none.
The sample in which `judge` decides takes as long as each of these."""

SETTLING = 5.0
"""Samples after the start that teach nothing: their torques are not yet those that acted."""

DRIFT = 5e-4
"""1/s: growth of the parameters' variances, relative to those at the start."""

LARGEST, OPENED = 4.0, 0.25
"""Largest variance of a parameter, and its increase after a change of the arm, over its variance at the start."""

RESTORED = 0.01
"""Share of the covariance that is left when the last good model returns."""

CERTAIN = 0.2
"""Largest standard deviation of each diagonal entry of M, relative to itself, in a model that may be used."""

SMOOTHING, LARGEST_MOVE = 0.05, 0.1
"""Time constant [s] with which the used parameters follow the estimates, and their largest change from one window to
the next, over their standard deviations at the start."""

FACTOR = 0.6
"""Largest relative change of a link's mass."""

LEAST_EIGENVALUE = 1e-6
"""Least eigenvalue of the pseudo-inertia of the last link with its payload, kg m² or kg."""

SLOWEST, SOFTEST = 0.01, 0.1
"""rad/s and rad/s², or m/s and m/s²: a joint below both teaches nothing."""


class ArmLearningMemory(eqx.Module):
    """Memory of `ArmLearning` between two samples.

    - `joints`: memory of `JointLearning`, which learns rotor inertia and friction of each joint alone.
    - `slot`: number of the next sample, counted from the end of the last window.
    - `clean`: samples since the last lost one.
    - `sums`: weighted sums of the four overlapping windows, from `window_sums`.
    - `equations`: equations of the last window.
    - `estimates`, `trust`: estimated parameters of the arm, and the evidence for them.
    - `filter_inertia`: inertia from which the estimator's bandwidth is computed, from the last window [n].
    """

    joints: Learning
    slot: Scalar
    clean: Scalar
    sums: Float[Array, "4 k n"]
    equations: Equations
    estimates: Estimates
    trust: Trust
    filter_inertia: Vector


class ArmLearning(AbstractAdaptation):
    """Recursive least squares over windows of 4 `samples` periods, for the parameters of the arm (`ArmParameters`).

    A window begins every `samples` periods. Weighted sums over it give position, velocity, acceleration and torque in
    its middle, without a lag. They yield one equation `τ - τ_nominal = aᵀθ` for each joint, linear in the parameters θ.
    The update is spread over the samples until the next window.

    The law interpolates between two models, with the weights 1 - α and α: that of `joints`, which learns each joint
    alone, and the arm's. α is 0 until every M_ii is known to 20 % and the arm's model explains the torque. It returns
    to 0 after a lasting change or a loss of samples (`judge`). A wrong model of the arm is thus no worse than none.

    θ is moved towards the set of arms that can exist: link factors in [0.4, 1.6], rotors within the limits of `joints`,
    and a positive definite pseudo-inertia of the last link with its payload. The used θ is projected onto this set.

    Source: docs/arm-learning.md; Atkeson, An and Hollerbach, Estimation of inertial parameters of manipulator loads and
    links, 1986; Wensing, Kim and Slotine, RA-L 2018.
    """

    title = "Payload, link masses, friction and rotors of the whole arm, learnt over smooth windows."
    moves_bias: ClassVar[bool] = True

    joints: JointLearning = piece(
        "learning of each joint, in use while the arm's model is not", default_factory=JointLearning
    )
    samples: int = parameter("samples between two windows", "", ">= 3", static=True, default=10)
    noise: PerJoint = parameter("r, standard deviation of a window's torque", "N m or N", "> 0", default=NOISE)
    mass: Scalar = parameter("standard deviation of the payload's mass at the start", "kg", "> 0", default=2.5)
    moment: Scalar = parameter("standard deviation of the payload's mass times centre", "kg m", "> 0", default=0.5)
    inertia: Scalar = parameter("standard deviation of the payload's inertia", "kg m²", "> 0", default=0.08)
    factor: PerJoint = parameter("standard deviation of a link's relative mass", "", "> 0", default=0.2)
    viscous: PerJoint = parameter("standard deviation of viscous friction", "N m s/rad or N s/m", "> 0", default=0.4)
    coulomb: PerJoint = parameter("standard deviation of Coulomb friction", "N m or N", "> 0", default=0.4)
    rotor: PerJoint = parameter("standard deviation of a rotor's inertia", "kg m² or kg", "> 0", default=0.15)
    stribeck: PerJoint | None = parameter(
        "v_st, Stribeck velocity of static friction that is learnt too; none by default",
        "rad/s or m/s",
        "> 0",
        default=None,
    )
    ripple: PerJoint | None = parameter(
        "N, periods per turn of torque ripple that is learnt too; none by default", "", "> 0", default=None
    )

    @property
    def shapes(self) -> TorqueShapes:
        """Functions of q and q̇ for Stribeck friction and ripple, whose coefficients are learnt."""
        return TorqueShapes(self.stribeck, self.ripple)

    def parameters(self, vector: Float[Array, " p"]) -> ArmParameters:
        """Return the arm's parameters from one vector θ, [p] in the order of `ArmParameters.of`."""
        return ArmParameters.of(vector, self.shapes.count)

    def deviations(self, joints: int) -> Float[Array, " p"]:
        """Return the standard deviation of each parameter at the start [p], in the order of `ArmParameters.of`."""
        payload = [self.mass[None], jnp.broadcast_to(self.moment, 3), jnp.broadcast_to(self.inertia, 6)]
        each = self.factor, self.viscous, *[self.coulomb] * (2 + self.shapes.count), self.rotor
        return jnp.concatenate([*payload, *(jnp.broadcast_to(value, joints) for value in each)])

    def init(self, measured: State) -> ArmLearningMemory:
        n = measured.q.size
        p, deviations = parameter_count(n, self.shapes.count), self.deviations(n)
        nothing = jnp.zeros(p)
        return ArmLearningMemory(
            joints=self.joints.init(measured),
            slot=jnp.zeros(()),
            clean=jnp.zeros(()) - SETTLING,
            sums=jnp.zeros((QUARTERS, KINDS + self.shapes.count, n)),
            equations=Equations(
                inertial=jnp.zeros((n, PAYLOAD + n)),
                drives=jnp.zeros((4 + self.shapes.count, n)),
                y=jnp.zeros(n),
                inertia=jnp.zeros(PAYLOAD + n),
                nominal=jnp.ones(()),
                weights=jnp.zeros(n),
                valid=jnp.zeros((), bool),
                loud=jnp.zeros(2, bool),
                fits=jnp.zeros((), bool),
                lost=jnp.zeros(()),
                left=jnp.zeros(n),
            ),
            estimates=Estimates(
                parameters=nothing,
                covariance=diagonal_covariance(deviations**2),
                used=nothing,
                good=nothing,
                deviation=deviations,
                inertia_deviation=jnp.ones(n),
                turn=jnp.zeros(()),
            ),
            trust=Trust.init(n, self.noise**2),
            filter_inertia=jnp.ones(n),
        )

    def __call__(self, experience: Experience, memory: ArmLearningMemory) -> ArmLearningMemory:
        m, x = self.samples, experience
        shapes = *friction_shapes(x.dq), *self.shapes.of(x.q, x.dq)
        sums = window_sums(memory.sums, memory.slot, m, x.period, x.q, x.tau, *shapes)
        clean = jnp.where(x.missed, 0.0, jnp.minimum(memory.clean + 1.0, float(QUARTERS * m)))
        slot, equations, estimates, trust = memory.slot, memory.equations, memory.estimates, memory.trust

        estimates = self._taught(slot, equations, estimates, trust.noise(self.noise**2))
        trust, estimates = jax.lax.cond(
            slot == m - 2,
            lambda: self._decided(x, equations, trust, estimates),
            lambda: (trust, estimates),
        )
        last = slot >= m - 1
        sums, equations, trust, inertia = jax.lax.cond(
            last,
            lambda: self._next(x, sums, clean >= QUARTERS * m, trust, estimates, memory),
            lambda: (sums, equations, trust, memory.filter_inertia),
        )
        joints, slot = self._joints_after(x, memory), jnp.where(last, 0.0, slot + 1.0)
        return ArmLearningMemory(joints, slot, clean, sums, equations, estimates, trust, inertia)

    def changed_links(self, memory: ArmLearningMemory) -> Bool[Array, ""]:
        return memory.slot == self.samples - 1

    def _joints_after(self, x: Experience, memory: ArmLearningMemory) -> Learning:
        """The memory of each joint's own learning after a sample.

        While the arm's model is in full use, each joint's rotor and friction are set from it. The joint's own learning
        starts from them when the arm changes. The rotor is the learnt one, or larger, so that with the nominal links
        the joint has at least its coupled inertia. More would make the feedback too strong, and less too weak.
        """
        joints, arm = self.joints(x, memory.joints), self.parameters(memory.estimates.used)
        rotor = jnp.maximum(arm.rotor, memory.filter_inertia - jnp.diagonal(x.mass))
        rotor = jnp.clip(self.counted + rotor, self.joints.rotor_min, self.joints.rotor_max)
        coulomb = jnp.clip(arm.coulomb, 0.0, self.joints.coulomb_max)
        full = (memory.trust.share >= 1.0) & (memory.trust.loud <= 0.0)
        both = jnp.where(full, rotor, joints.rotor), jnp.where(full, coulomb, joints.coulomb)
        return eqx.tree_at(lambda own: (own.rotor, own.coulomb), joints, both)

    def _taught(self, slot: Scalar, equations: Equations, estimates: Estimates, variance: Vector) -> Estimates:
        """The estimates after this sample's share of the equations; `variance`: of the equations' noise [n]."""
        n = equations.y.size
        share = math.ceil(n / min(BUSY, self.samples - 2))

        def taught() -> tuple[Float[Array, " p"], Float[Array, " c"]]:
            both = estimates.parameters, estimates.covariance
            for k in range(share):
                number = share * slot.astype(int) + k
                at = jnp.minimum(number, n - 1)
                weight = equations.weights[at]
                both = jax.lax.cond(
                    (number < n) & (weight > 0.0),
                    lambda both=both, at=at, weight=weight: measured_once(
                        *both, equations.row(at), equations.y[at], variance[at] / weight
                    ),
                    lambda both=both: both,
                )
            return both

        before = estimates.parameters, estimates.covariance
        both = jax.lax.cond(share * slot < n, taught, lambda: before)
        return eqx.tree_at(lambda e: (e.parameters, e.covariance), estimates, both)

    def _next(
        self,
        x: Experience,
        sums: Float[Array, "4 k n"],
        valid: Bool[Array, ""],
        trust: Trust,
        estimates: Estimates,
        memory: ArmLearningMemory,
    ) -> tuple[Float[Array, "4 k n"], Equations, Trust, Vector]:
        """The sums, equations, trust and estimator inertia after a window that ends with this sample.

        - `memory`: before this sample.
        """
        window, arm = Window.of(sums), articulated(x.nominal)
        n = window.q.size
        own = inertial_regressor(arm, window.q, window.dq, window.ddq)
        turn = jnp.arange(n, dtype=float) == estimates.turn
        equations = eqx.tree_at(
            lambda e: (e.inertial, e.drives, e.y, e.inertia, e.nominal),
            memory.equations,
            (
                own.torque,
                jnp.stack([window.dq, window.first, window.second, *window.more, window.ddq]),
                window.tau - jnp.sum(own.torque[:, PAYLOAD:], axis=1) - arm.armature * window.ddq,
                jnp.sum(jnp.where(turn[:, None], own.inertia, 0.0), axis=0),
                jnp.sum(jnp.where(turn, jnp.sum(own.inertia[:, PAYLOAD:], axis=1) + arm.armature, 0.0)),
            ),
        )
        y = equations.y
        missed = y - equations.explained(estimates.parameters)
        missed_by_good = y - equations.explained(estimates.good)
        moves = (jnp.abs(window.dq) > SLOWEST) | (jnp.abs(window.ddq) > SOFTEST)
        heard, before, both = valid & moves, trust, jnp.stack([missed, missed_by_good])
        trust, loud = before.after_window(both, y, window.first, heard, self.noise**2, self.samples * x.period)
        carried = jnp.sum(own.torque[:, :PAYLOAD] * estimates.parameters[:PAYLOAD], axis=1)
        fits, lost, left = lost_payload(missed, carried, heard, self.noise**2)
        fitted, weights = memory.equations.fits, jnp.where(heard, before.weights(missed * missed, loud[0]), 0.0)
        lost = jnp.where(loud[0] & fits & fitted & (lost > LEAST_LOST), lost, 0.0)
        equations = eqx.tree_at(
            lambda e: (e.weights, e.valid, e.loud, e.fits, e.lost, e.left),
            equations,
            (weights, valid, loud, fits, lost, left),
        )
        now = eqx.tree_at(lambda own: (own.estimates, own.trust), memory, (estimates, trust))
        inertia = coupled_inertia(self.robot(arm, now).mass(x.q), trust.share)
        return next_windows(sums), equations, trust, inertia

    def _decided(
        self, x: Experience, equations: Equations, trust: Trust, estimates: Estimates
    ) -> tuple[Trust, Estimates]:
        """Trust and estimates after a window's equations."""
        n, duration = equations.y.size, self.samples * x.period
        spread = self.deviations(n)
        relative = self._inertia_deviation(equations, estimates)
        in_use, learnt = trust.share > 0.0, self.parameters(estimates.parameters)
        rubbed, change = trust.friction_change(learnt.coulomb, self.joints.coulomb_max, duration)
        certain, e = jnp.all(relative < CERTAIN), equations
        trust, verdict = judge(trust, certain, e.valid, e.loud, e.lost, e.left, rubbed, self.noise**2, duration)
        place = np.arange(spread.size)
        of_payload, of_friction = place < PAYLOAD, (place >= PAYLOAD + n) & (place < spread.size - n)
        with_change = eqx.tree_at(lambda arm: arm.first, learnt, learnt.first + change).vector()
        parameters = jnp.where(verdict.rubs, with_change, estimates.parameters)
        parameters = jnp.where(verdict.restores, estimates.good, parameters)
        parameters = jnp.where(verdict.unloads & of_payload, (1.0 - equations.lost) * parameters, parameters)
        # Only what teaches may fade: rest forgets nothing.
        share = jnp.mean(equations.weights)
        opens = verdict.opens | (verdict.unloads & of_payload) | (verdict.rubs & of_friction)
        growth = DRIFT * duration * share + jnp.where(opens, OPENED, 0.0)
        # The covariance is of the model that is given up, and the good one is known better.
        covariance = estimates.covariance * jnp.where(verdict.restores, RESTORED, 1.0)
        covariance = with_drift(covariance, growth * spread**2, LARGEST * spread**2)
        parameters = self._steered(x, parameters, covariance)
        move = -jnp.expm1(-duration / SMOOTHING) * (parameters - estimates.used)
        used = estimates.used + jnp.clip(move, -LARGEST_MOVE * spread, LARGEST_MOVE * spread)
        # A model that is given up, or not yet in use, must not be on the way to the good one.
        used = self._consistent(x, jnp.where(in_use & ~verdict.restores & ~verdict.unloads, used, parameters))
        return trust, Estimates(
            parameters=parameters,
            covariance=covariance,
            used=used,
            good=jnp.where(verdict.keeps, used, estimates.good),
            deviation=standard_deviations(covariance, parameters.size),
            inertia_deviation=relative,
            turn=jnp.where(estimates.turn >= n - 1, 0.0, estimates.turn + 1.0),
        )

    def _inertia_deviation(self, equations: Equations, estimates: Estimates) -> Vector:
        """`√(m_iᵀ P m_i)/M_ii` with `m_i = ∂M_ii/∂θ` [n]; each window updates one joint."""
        n, p = equations.y.size, estimates.parameters.size
        turn = jnp.arange(n, dtype=float) == estimates.turn
        inertia, nominal = equations.inertia, equations.nominal
        row = jnp.concatenate([inertia, jnp.zeros(p - inertia.size - n), jnp.where(turn, 1.0, 0.0)])
        variance = quadratic_form(estimates.covariance, row)
        mass = jnp.maximum(nominal + jnp.sum(row * estimates.parameters), 0.1 * nominal)
        return jnp.where(turn, jnp.sqrt(jnp.maximum(variance, 0.0)) / mass, estimates.inertia_deviation)

    def _steered(self, x: Experience, vector: Float[Array, " p"], covariance: Float[Array, " c"]) -> Float[Array, " p"]:
        """The parameters, moved along P towards the most violated constraint of an arm that can exist."""
        parameters, arm = self.parameters(vector), articulated(x.nominal)
        n, p = parameters.rotor.size, vector.size
        value, slope = least_eigenvalue(self._last_body(arm, parameters))
        link = link_body(arm)
        of_body = jnp.zeros(p).at[:PAYLOAD].set(slope).at[PAYLOAD + arm.tip_joint].set(jnp.sum(slope * link))
        bounded = np.concatenate([np.arange(PAYLOAD, PAYLOAD + n), np.arange(p - n, p)])
        beyond = jnp.clip(vector[bounded], *self._bounds(n)) - vector[bounded]
        worst = jnp.arange(2 * n) == jnp.argmax(jnp.abs(beyond))
        of_bound = jnp.zeros(p).at[bounded].set(jnp.where(worst, 1.0, 0.0))
        inside = value >= LEAST_EIGENVALUE
        row = jnp.where(inside, of_bound, of_body)
        missing = jnp.where(inside, jnp.sum(jnp.where(worst, beyond, 0.0)), LEAST_EIGENVALUE - value)
        return jax.lax.cond(missing != 0.0, lambda: moved_along(vector, covariance, row, missing), lambda: vector)

    def _consistent(self, x: Experience, vector: Float[Array, " p"]) -> Float[Array, " p"]:
        """The parameters, projected onto the set of arms that can exist."""
        parameters, arm = self.parameters(vector), articulated(x.nominal)
        n = parameters.rotor.size
        lower, upper = self._bounds(n)
        parameters = eqx.tree_at(
            lambda own: (own.factors, own.rotor),
            parameters,
            (jnp.clip(parameters.factors, lower[:n], upper[:n]), jnp.clip(parameters.rotor, lower[n:], upper[n:])),
        )
        body = self._last_body(arm, parameters)
        payload = parameters.payload + (nearest_body(body, LEAST_EIGENVALUE) - body)
        return eqx.tree_at(lambda own: own.payload, parameters, payload).vector()

    def _last_body(self, arm: Articulated, parameters: ArmParameters) -> Float[Array, "10"]:
        return parameters.payload + (1.0 + parameters.factors[arm.tip_joint]) * link_body(arm)

    def _bounds(self, n: int) -> tuple[Float[Array, "m"], Float[Array, "m"]]:
        """Bounds of link factors and changes of the rotors [2 n]."""
        limits = self.joints.rotor_min - self.counted, self.joints.rotor_max - self.counted
        lower, upper = (jnp.broadcast_to(limit, n) for limit in limits)
        return jnp.concatenate([jnp.full(n, -FACTOR), lower]), jnp.concatenate([jnp.full(n, FACTOR), upper])

    def learnt(self, memory: ArmLearningMemory) -> LearnedParameters:
        own, share = self.joints.learnt(memory.joints), memory.trust.share
        arm = self.parameters(memory.estimates.used)
        return LearnedParameters(
            rotor=own.rotor + share * (self.counted + arm.rotor - own.rotor),
            coulomb=own.coulomb + share * (arm.coulomb - own.coulomb),
        )

    def robot(self, nominal: AbstractRobot, memory: ArmLearningMemory) -> Believed:
        """Return the arm that the law uses: α times the learnt payload, links and ripple, and the learnt rotors."""
        own = self.parameters(memory.estimates.used)
        arm: AbstractRobot = arm_with(nominal, memory.trust.share, own)
        if self.ripple is not None and own.more is not None:
            arm = Rippled(arm.joint_units, arm.joint_names, arm, self.shapes, memory.trust.share * own.more)
        return Believed.of(arm, self.learnt(memory).rotor, self.counted)

    def filter_inertia(self, robot: AbstractRobot, q: Vector, memory: ArmLearningMemory) -> Vector:
        """Return `coupled_inertia` after the last window, [n], kg m² or kg; while α is 0, `M̂_ii` at q."""
        return jax.lax.cond(
            memory.trust.share > 0.0, lambda: memory.filter_inertia, lambda: jnp.diagonal(robot.mass(q))
        )

    def mass_at_start(self, mass: Matrix) -> Matrix:
        return self.joints.mass_at_start(mass)

    def friction(self, memory: ArmLearningMemory, dq: Vector) -> Vector:
        own = self.joints.friction(memory.joints, dq)
        arm = self.parameters(memory.estimates.used)
        learnt = arm.friction(dq)
        if arm.more is not None:
            learnt = learnt + self.shapes.friction(dq, arm.more)
        return own + memory.trust.share * (learnt - own)

    def share(self, memory: ArmLearningMemory) -> Scalar:
        """Return α, the weight of the learnt arm model in the model that the law uses, 0 to 1."""
        return memory.trust.share

    def settled(self, memory: ArmLearningMemory) -> Bool[Array, ""]:
        """True while α is 1: the law uses the learnt arm model alone."""
        return memory.trust.share >= 1.0

    def signals(self, memory: ArmLearningMemory) -> dict[str, Array]:
        """Return `rotor`, `coulomb`, and the arm's parameters with their standard deviations, by name, for logs.

        `arm_share` is α. `inertia_deviation` [n] is the standard deviation of M_ii over M_ii. `static_excess`,
        `ripple_cosine` and `ripple_sine` [n] are the coefficients of Stribeck friction and ripple, if they are learnt.
        """
        arm, deviation = (self.parameters(v) for v in (memory.estimates.used, memory.estimates.deviation))
        return {
            **super().signals(memory),
            "arm_share": memory.trust.share,
            "inertia_deviation": memory.estimates.inertia_deviation,
            "payload_mass": arm.payload[0],
            "payload_mass_deviation": deviation.payload[0],
            "link_factors": 1.0 + arm.factors,
            "link_factors_deviation": deviation.factors,
            "viscous": arm.viscous,
            "viscous_deviation": deviation.viscous,
            "rotor_deviation": deviation.rotor,
            **self.shapes.signals(arm.more),
        }

    def frozen(self, memory: ArmLearningMemory) -> AbstractAdaptation:
        """Return the model in use as a constant adaptation, without Stribeck friction and ripple."""
        learnt, arm = self.learnt(memory), self.parameters(memory.trust.share * memory.estimates.used)
        own = (1.0 - memory.trust.share) * self.joints.learnt(memory.joints).coulomb
        return KnownArm(
            counted=self.counted,
            smoothing=self.smoothing,
            payload=arm.payload,
            factors=arm.factors,
            viscous=arm.viscous,
            first=arm.first + own,
            second=arm.second,
            rotor=learnt.rotor,
        )

    @classmethod
    def of_arm(
        cls, joints: JointLearning, *, inertia_matrix: Any, deviation: Any, period: float, **parameters: Any
    ) -> ArmLearning:
        """Return the adaptation for an arm, with windows of about 40 ms and at least twelve periods, and their noise.

        - `joints`: adaptation of each joint alone, from `JointLearning.of_arm`.
        - `inertia_matrix`: M of the nominal arm at a working posture [n n].
        - `deviation`, `period`: as of `JointLearning.of_arm`.
        - `parameters`: parameters that replace the defaults.

        Raises DefinitionError if one of them is out of its range.
        """
        known: dict[str, Any] = {"counted": joints.counted, "smoothing": joints.smoothing, "joints": joints}
        known["samples"] = max(FEWEST, round(UPDATE_TIME / period))
        known |= {name: value for name, value in parameters.items() if value is not None}
        return cls(**{"noise": window_noise(inertia_matrix, deviation, known["samples"], period), **known})
