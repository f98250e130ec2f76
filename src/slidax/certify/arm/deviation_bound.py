"""Change of the disturbance by a deviation from the reference or from the predicted state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.simulation.plant import Plant

from ..sampled_scenario import Floats
from .arm_motion import NominalModel, StateSequence, distinct_inertias, outer_torque, rigid_body_torque
from .hull import Hull
from .inertia_bounds import PostureGrid, require_independent_joints

STEP = 1e-4
"""Step of a difference quotient, rad or m. By Bernstein's inequality its relative error is at most `D³ STEP²/6`."""

SPARE = 1e-6
"""Relative increase of the difference quotients, which covers their error."""


@dataclass(frozen=True, eq=False)
class DeviationBound:
    """`|w*(q_d + e, q̇_d + ė) - w*(q_d, q̇_d)|` for all `|e| <= r`, `|ė| <= v` and every member of a set.

    With D the model's torque error without friction, `M̂(q) (w - w_d) = D(q,q̇) - D_d - (M̂(q) - M̂_d) w_d + δ`, where δ
    is the change of friction and external forces. Terms linear in e and ė are computed, the others bounded: D and M̂ are
    trigonometric polynomials, whose second derivatives Bernstein's inequality bounds. `M̂(q)⁻¹` follows from M̂_d⁻¹ by
    Neumann's series (docs/certificates/reference.md).

    - `inverse`: |M̂⁻¹| along the motion, for each possible model of the law [B N n n].
    - `along_q`, `along_dq`: bounds of the slopes of `D - M̂ w_d` [N n n].
    - `mass_slope`: |∂M̂_ij/∂q_k| along the motion [N n n n].
    - `mass`: bounds of |M̂| anywhere [n n].
    - `curved`: bounds of `|D - M̂ w_d|` anywhere, at the reference's velocity [N n].
    - `coriolis`: bounds of D's coefficients of q̇_j q̇_k anywhere [n n n].
    - `rates`: D_j of Bernstein's inequality [n].
    """

    motion: StateSequence
    plants: list[Plant]
    hull: Hull
    inverse: Floats
    along_q: Floats
    along_dq: Floats
    mass_slope: Floats
    mass: Floats
    curved: Floats
    coriolis: Floats
    rates: Floats

    def __call__(self, radius: Floats, speed: Floats) -> Floats:
        """Return the bound [N n], rad/s² or m/s²; inf where the deviation is too large for one.

        - `radius`: r, bound of each joint's error [n] or [N n], rad or m.
        - `speed`: v, bound of its rate [n] or [N n], or one below and one above zero [2 N n], rad/s or m/s.
        """
        shape = self.motion.q.shape
        r, speeds = np.broadcast_to(radius, shape), np.broadcast_to(speed, (2, *shape))
        v = speeds.max(axis=0)
        sigma: Floats = np.einsum("kj,j->k", r, self.rates)[:, None]
        dq = np.abs(self.motion.dq)
        torque: Floats = np.einsum("kij,kj->ki", self.along_q, r) + np.einsum("kij,kj->ki", self.along_dq, v)
        # The factors are at most 2, since no function changes by more than twice its largest value.
        torque += np.minimum(0.5 * sigma**2, 2.0) * self.curved
        torque += 2.0 * np.minimum(sigma, 2.0) * np.einsum("ijl,kj,kl->ki", self.coriolis, dq, v)
        torque += np.einsum("ijl,kj,kl->ki", self.coriolis, v, v)
        torque += self._outer(r, speeds)
        mass_change: Floats = (
            np.einsum("kijl,kl->kij", self.mass_slope, r) + np.minimum(0.5 * sigma**2, 2.0)[:, :, None] * self.mass
        )
        return np.array([_neumann_bound(inverse, mass_change, torque) for inverse in self.inverse]).max(axis=0)

    def _outer(self, r: Floats, speeds: Floats) -> Floats:
        """Return the largest change of friction and external forces [N n]; each is monotonic in its joint's q and q̇."""
        undisturbed = outer_torque(self.plants, self.motion)
        worst = np.zeros(r.shape)
        position_shifts = [-r, r] if _depends_on_position(self.plants, self.motion) else [np.zeros_like(r)]
        for dq_shift in (-speeds[0], speeds[1]):
            for q_shift in position_shifts:
                shifted = outer_torque(self.plants, self.motion.shifted(q_shift, dq_shift))
                worst = np.maximum(worst, self.hull.largest(shifted - undisturbed))
        return worst


def deviation_bound(
    belief: NominalModel,
    motion: StateSequence,
    plants: list[Plant],
    hull: Hull,
    disturbance: Floats,
    learnt: Sequence[NominalModel] = (),
) -> DeviationBound:
    """Return the deviation bound around a motion.

    - `plants`, `hull`: arms at the hull's points, and the hull.
    - `disturbance`: w* of each of these arms along the motion [P N n]; with `learnt` a bound for all [1 N n].
    - `learnt`: in place of `belief`, the learned model of each of some members.
    """
    beliefs = learnt or [belief]
    distinct, indices = distinct_inertias(plants)
    along_q, along_dq, mass_slope = _slopes(belief, motion, (distinct, indices), hull, None if learnt else disturbance)
    mass, difference, weight, coriolis, rates = _global_bounds(belief, motion, distinct, hull.merged(indices))
    size = disturbance[0] if learnt else hull.largest(disturbance)
    if learnt:
        along_q = along_q + np.einsum("kijl,kj->kil", mass_slope, size)
    dq, ddq = np.abs(motion.dq), np.abs(motion.ddq)
    curved = ddq @ difference.T + weight + np.einsum("ijl,kj,kl->ki", coriolis, dq, dq) + size @ mass.T
    at_first, _ = belief.at_first(motion.t, motion.q, motion.dq)
    masses = [model.learnt(at_first, motion.t) for model in beliefs]
    return DeviationBound(
        motion=motion,
        plants=plants,
        hull=hull,
        inverse=np.abs(np.linalg.inv(np.array(masses))),
        along_q=along_q,
        along_dq=along_dq,
        mass_slope=mass_slope,
        mass=mass,
        curved=curved,
        coriolis=coriolis,
        rates=rates,
    )


def _slopes(
    belief: NominalModel,
    motion: StateSequence,
    members: tuple[list[Plant], list[int]],
    hull: Hull,
    disturbance: Floats | None,
) -> tuple[Floats, Floats, Floats]:
    """Return bounds of |∂(D - M̂ w_d)/∂q|, or of |∂D/∂q| without w_d, of |∂D/∂q̇| and |∂M̂/∂q| along the motion."""
    n = motion.joints
    distinct, indices = members
    along_q = np.zeros((*motion.q.shape, n))
    nominal_slope = np.zeros((*motion.q.shape, n, n))
    error_slope = np.zeros((len(distinct), *motion.q.shape, n, n))
    for joint in range(n):
        step = np.where(np.arange(n) == joint, STEP, 0.0)
        torques = []
        for sign in (0.5 / STEP, -0.5 / STEP):
            shifted = motion.shifted(np.sign(sign) * step, np.zeros(n))
            mass, bias = belief.mass_and_bias(shifted.t, shifted.q, shifted.dq)
            masses, true_torques = rigid_body_torque(distinct, shifted)
            nominal_slope[..., joint] += sign * mass
            error_slope[..., joint] += sign * (mass - masses)
            torques.append(sign * (np.einsum("kij,kj->ki", mass, shifted.ddq) + bias - true_torques))
        slope = torques[0] + torques[1]
        if disturbance is None:
            along_q[..., joint] = (1.0 + SPARE) * hull.merged(indices).largest(slope)
        else:
            lumped = np.einsum("kij,pkj->pki", nominal_slope[..., joint], disturbance)
            along_q[..., joint] = (1.0 + SPARE) * hull.largest(slope[indices] - lumped)
    # The bias is Γ_ijk q̇_j q̇_k, with Christoffel's Γ of the mass; its slope along q̇_j is 2 Γ_ijk q̇_k.
    speed_slope = np.einsum("pkijl,kl->pkij", error_slope, motion.dq)
    speed_slope += np.einsum("pkilj,kl->pkij", error_slope, motion.dq)
    speed_slope -= np.einsum("pkjli,kl->pkij", error_slope, motion.dq)
    return along_q, (1.0 + SPARE) * hull.merged(indices).largest(speed_slope), (1.0 + SPARE) * np.abs(nominal_slope)


def _global_bounds(
    belief: NominalModel, motion: StateSequence, plants: list[Plant], hull: Hull
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return bounds over all postures and members, and the D_j.

    They are |M̂| and |M̂ - M| [n n], |G0 - G| [n] and D's coefficients [n n n]. D's coefficients of `q̇_j q̇_k` are
    Christoffel's, `(∂_k D_ij + ∂_j D_ik - ∂_i D_jk)/2` of `M̂ - M`.
    """

    def at(q: Floats) -> tuple[Floats, Floats]:
        # At this time timed payloads are carried.
        loads = [float(plant.load.attached) for plant in plants if plant.load is not None]
        states = StateSequence(np.full(len(q), max(loads, default=0.0)), q, np.zeros_like(q), np.zeros_like(q))
        mass, weight = belief.mass_and_bias(states.t, q, states.dq)
        masses, torques = rigid_body_torque(plants, states)
        return (
            np.concatenate([mass[None], mass[None] - masses]).swapaxes(0, 1),
            (weight[None] - torques).swapaxes(0, 1),
        )

    def flat(q: Floats) -> Floats:
        return np.concatenate([values.reshape(len(q), -1) for values in at(q)], axis=1)

    require_independent_joints(belief.robot)
    reach = np.abs(motion.q).max(axis=0) + 1.0
    grid = PostureGrid.of(flat, belief.robot.joint_units, -reach, reach)
    masses, weights = (values.swapaxes(0, 1) for values in at(grid.postures))
    mass_error = [grid.series(values) for part in hull.of(masses[1:]) for values in part]
    corners = len(hull.corners)

    def worst(bounds: list[Floats]) -> Floats:
        return np.max(bounds[:corners], axis=0) + np.sum(bounds[corners:], axis=0)

    difference = worst([series.bound() for series in mass_error])
    weight = worst([grid.series(values).bound() for part in hull.of(weights) for values in part])
    slope = worst([series.slopes() for series in mass_error])
    coriolis = 0.5 * (slope + slope.transpose(0, 2, 1) + slope.transpose(2, 0, 1))
    return grid.series(masses[0]).bound(), difference, weight, coriolis, grid.rates()


def _depends_on_position(plants: list[Plant], motion: StateSequence) -> bool:
    """Return True if external forces depend on the joint positions."""
    few = StateSequence(motion.t[:8], motion.q[:8], motion.dq[:8], motion.ddq[:8])
    torque = outer_torque(plants[:1], few)
    shifted = [few.shifted(np.full(few.joints, shift), np.zeros(few.joints)) for shift in (10.0, -10.0)]
    return any(np.any(outer_torque(plants[:1], states) != torque) for states in shifted)


def _neumann_bound(inverse: Floats, mass_change: Floats, torque: Floats) -> Floats:
    """Return `(1 - |M̂_d⁻¹| |δM̂|)⁻¹ |M̂_d⁻¹| b` [N n]; inf where this series does not converge."""
    n = torque.shape[1]
    matrix = inverse @ mass_change
    bound = np.full(torque.shape, np.inf)
    converges = np.abs(np.linalg.eigvals(matrix)).max(axis=1) < 0.999
    right = np.einsum("kij,kj->ki", inverse, torque)
    bound[converges] = np.linalg.solve(np.eye(n) - matrix[converges], right[converges][..., None])[..., 0]
    return bound


@dataclass(frozen=True, eq=False)
class PredictionErrorBound:
    """`|M̂⁻¹ (∂(M̂ a + C0 q̇ + G0)/∂q e + ∂(C0 q̇)/∂q̇ ė)|` for prediction errors e of q and ė of q̇; `a = q̈ - w*`.

    - `along_q`, `along_dq`: these slopes along a motion, the largest of all models [N n n].
    """

    along_q: Floats
    along_dq: Floats

    @classmethod
    def of(cls, beliefs: Sequence[NominalModel], motion: StateSequence, disturbance: Floats) -> PredictionErrorBound:
        """Return the slopes by central differences.

        - `beliefs`: possible models of the law, all with the same initial model.
        - `disturbance`: bounds of |w*| [N n], which the command compensates.
        """
        n, first = motion.joints, beliefs[0]
        slopes = np.zeros((2, *motion.q.shape, n))
        initial, _ = first.at_first(motion.t, motion.q, motion.dq)
        inverses = [np.linalg.inv(belief.learnt(initial, motion.t)) for belief in beliefs]
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            for k, (q_step, dq_step) in enumerate(((step, 0.0 * step), (0.0 * step, step))):
                shifted = [motion.shifted(sign * q_step, sign * dq_step) for sign in (1.0, -1.0)]
                (upper, upper_bias), (lower, lower_bias) = (first.at_first(side.t, side.q, side.dq) for side in shifted)
                for belief, inverse in zip(beliefs, inverses, strict=True):
                    mass_change = belief.learnt(upper, motion.t) - belief.learnt(lower, motion.t)
                    torque = np.einsum("kij,kj->ki", mass_change, motion.ddq) + (upper_bias - lower_bias)
                    slope = np.abs(np.einsum("kij,kj->ki", inverse, torque))
                    slope += np.einsum("kij,kj->ki", np.abs(inverse @ mass_change), disturbance)
                    slope /= 2.0 * STEP
                    slopes[k, ..., joint] = np.maximum(slopes[k, ..., joint], (1.0 + SPARE) * slope)
        return cls(slopes[0], slopes[1])

    def __call__(self, radius: Floats, speed: Floats) -> Floats:
        """Return the bound [N n], rad/s² or m/s².

        - `radius`: prediction error of q [N n], rad or m.
        - `speed`: prediction error of q̇ [N n], rad/s or m/s.
        """
        return np.einsum("kij,kj->ki", self.along_q, radius) + np.einsum("kij,kj->ki", self.along_dq, speed)
