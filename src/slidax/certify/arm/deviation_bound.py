"""Additional disturbance when the arm deviates from its reference or from its predicted state."""

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
"""Share by which difference quotients are enlarged to cover their error."""


@dataclass(frozen=True, eq=False)
class DeviationBound:
    """`|w*(q_d + e, q̇_d + ė) - w*(q_d, q̇_d)|` for all `|e| <= r`, `|ė| <= v` and every member of a set.

    With D the torque that the model lacks without friction, `M̂(q) (w - w_d) = D(q,q̇) - D_d - (M̂(q) - M̂_d) w_d + δ`,
    where δ is the change of friction and external forces. Terms linear in e and ė are computed, the others bounded: D
    and M̂ are trigonometric polynomials, whose second derivatives Bernstein's inequality bounds. `M̂(q)⁻¹` follows from
    M̂_d⁻¹ by Neumann's series (docs/certificates/arm.md).

    - `inverse`: |M̂⁻¹| along the motion, for each model that the law may have [B N n n].
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
        """The bound [N n], rad/s² or m/s²; inf where the deviation is too large for one.

        - `radius`: r, of each joint's error [n] or [N n], rad or m.
        - `speed`: v, of its rate [n] or [N n], or below and above zero [2 N n], rad/s or m/s.
        """
        shape = self.motion.q.shape
        r, ways = np.broadcast_to(radius, shape), np.broadcast_to(speed, (2, *shape))
        v = ways.max(axis=0)
        sigma: Floats = np.einsum("kj,j->k", r, self.rates)[:, None]
        dq = np.abs(self.motion.dq)
        lacks: Floats = np.einsum("kij,kj->ki", self.along_q, r) + np.einsum("kij,kj->ki", self.along_dq, v)
        # At most the difference between the two extremes.
        lacks += np.minimum(0.5 * sigma**2, 2.0) * self.curved
        lacks += 2.0 * np.minimum(sigma, 2.0) * np.einsum("ijl,kj,kl->ki", self.coriolis, dq, v)
        lacks += np.einsum("ijl,kj,kl->ki", self.coriolis, v, v)
        lacks += self._outer(r, ways)
        moved: Floats = (
            np.einsum("kijl,kl->kij", self.mass_slope, r) + np.minimum(0.5 * sigma**2, 2.0)[:, :, None] * self.mass
        )
        return np.array([_solved(inverse, moved, lacks) for inverse in self.inverse]).max(axis=0)

    def _outer(self, r: Floats, ways: Floats) -> Floats:
        """Largest change of friction and external forces [N n]: each is monotonic in its joint's own q and q̇."""
        here = outer_torque(self.plants, self.motion)
        worst = np.zeros(r.shape)
        still = np.zeros_like(r)
        places = [still] if not _moves(self.plants, self.motion) else [-r, r]
        for place in places:
            for side in (-ways[0], ways[1]):
                worst = np.maximum(
                    worst, self.hull.largest(outer_torque(self.plants, self.motion.shifted(place, side)) - here)
                )
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

    - `plants`, `hull`: the members.
    - `disturbance`: w* of each of these along the motion [P N n]; with `learnt` a bound for all [1 N n].
    - `learnt`: in place of `belief`, the learned model of each of some members.
    """
    beliefs = learnt or [belief]
    alike = distinct_inertias(plants)
    along_q, along_dq, mass_slope = _slopes(belief, motion, alike, hull, None if learnt else disturbance)
    mass, difference, weight, coriolis, rates = _anywhere(belief, motion, alike[0], hull.merged(alike[1]))
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
    """Bounds of |∂(D - M̂ w_d)/∂q|, or of |∂D/∂q| without w_d, of |∂D/∂q̇| and |∂M̂/∂q| along the motion."""
    n = motion.joints
    kinds, which = members
    still = np.zeros(n)
    along_q = np.zeros((*motion.q.shape, n))
    own_slope = np.zeros((*motion.q.shape, n, n))
    lacked_slope = np.zeros((len(kinds), *motion.q.shape, n, n))
    for joint in range(n):
        step = np.where(np.arange(n) == joint, STEP, 0.0)
        torques = []
        for sign in (0.5 / STEP, -0.5 / STEP):
            there = motion.shifted(np.sign(sign) * step, still)
            mass, bias = belief.mass_and_bias(there.t, there.q, there.dq)
            masses, needs = rigid_body_torque(kinds, there)
            own_slope[..., joint] += sign * mass
            lacked_slope[..., joint] += sign * (mass - masses)
            torques.append(sign * (np.einsum("kij,kj->ki", mass, there.ddq) + bias - needs))
        slope = torques[0] + torques[1]
        if disturbance is None:
            along_q[..., joint] = (1.0 + SPARE) * hull.merged(which).largest(slope)
        else:
            lumped = np.einsum("kij,pkj->pki", own_slope[..., joint], disturbance)
            along_q[..., joint] = (1.0 + SPARE) * hull.largest(slope[which] - lumped)
    # The bias is Γ_ijk q̇_j q̇_k, with Christoffel's Γ of the mass; its slope along q̇_j is 2 Γ_ijk q̇_k.
    turned = np.einsum("pkijl,kl->pkij", lacked_slope, motion.dq)
    turned += np.einsum("pkilj,kl->pkij", lacked_slope, motion.dq)
    turned -= np.einsum("pkjli,kl->pkij", lacked_slope, motion.dq)
    return along_q, (1.0 + SPARE) * hull.merged(which).largest(turned), (1.0 + SPARE) * np.abs(own_slope)


def _anywhere(
    belief: NominalModel, motion: StateSequence, plants: list[Plant], hull: Hull
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Bounds over all postures and members: |M̂|, |M̂ - M| [n n], |G0 - G| [n], D's coefficients [n n n], and the D_j.

    D's coefficients of `q̇_j q̇_k` are Christoffel's, `(∂_k D_ij + ∂_j D_ik - ∂_i D_jk)/2` of `M̂ - M`.
    """

    def at(q: Floats) -> tuple[Floats, Floats]:
        # A timed payload counts as carried.
        loads = [float(plant.load.attached) for plant in plants if plant.load is not None]
        there = StateSequence(np.full(len(q), max(loads, default=0.0)), q, np.zeros_like(q), np.zeros_like(q))
        mass, weight = belief.mass_and_bias(there.t, q, there.dq)
        masses, torques = rigid_body_torque(plants, there)
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
    lacked = [grid.series(values) for part in hull.of(masses[1:]) for values in part]
    corners = len(hull.corners)

    def worst(bounds: list[Floats]) -> Floats:
        return np.max(bounds[:corners], axis=0) + np.sum(bounds[corners:], axis=0)

    difference = worst([series.bound() for series in lacked])
    weight = worst([grid.series(values).bound() for part in hull.of(weights) for values in part])
    slope = worst([series.slopes() for series in lacked])
    coriolis = 0.5 * (slope + slope.transpose(0, 2, 1) + slope.transpose(2, 0, 1))
    return grid.series(masses[0]).bound(), difference, weight, coriolis, grid.rates()


def _moves(plants: list[Plant], motion: StateSequence) -> bool:
    """True if external forces depend on the joint positions."""
    few = StateSequence(motion.t[:8], motion.q[:8], motion.dq[:8], motion.ddq[:8])
    far = few.shifted(np.full(few.joints, 10.0), np.zeros(few.joints))
    near = few.shifted(np.full(few.joints, -10.0), np.zeros(few.joints))
    here = outer_torque(plants[:1], few)
    return bool(np.any(outer_torque(plants[:1], far) != here) or np.any(outer_torque(plants[:1], near) != here))


def _solved(inverse: Floats, moved: Floats, lacks: Floats) -> Floats:
    """`(1 - |M̂_d⁻¹| |δM̂|)⁻¹ |M̂_d⁻¹| b` [N n]; inf where that series does not converge."""
    n = lacks.shape[1]
    matrix = inverse @ moved
    bound = np.full(lacks.shape, np.inf)
    converges = np.abs(np.linalg.eigvals(matrix)).max(axis=1) < 0.999
    right = np.einsum("kij,kj->ki", inverse, lacks)
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
        """The slopes by central differences.

        - `beliefs`: models that the law may have, all learned from one arm.
        - `disturbance`: bounds of |w*| [N n], which the command compensates.
        """
        n, first = motion.joints, beliefs[0]
        slopes = np.zeros((2, *motion.q.shape, n))
        known, _ = first.at_first(motion.t, motion.q, motion.dq)
        inverse = [np.linalg.inv(belief.learnt(known, motion.t)) for belief in beliefs]
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            for k, way in enumerate(((step, 0.0 * step), (0.0 * step, step))):
                there = [motion.shifted(sign * way[0], sign * way[1]) for sign in (1.0, -1.0)]
                (most, above), (least, below) = (first.at_first(side.t, side.q, side.dq) for side in there)
                for belief, back in zip(beliefs, inverse, strict=True):
                    moved = belief.learnt(most, motion.t) - belief.learnt(least, motion.t)
                    torque = np.einsum("kij,kj->ki", moved, motion.ddq) + (above - below)
                    slope = np.abs(np.einsum("kij,kj->ki", back, torque))
                    slope += np.einsum("kij,kj->ki", np.abs(back @ moved), disturbance)
                    slope /= 2.0 * STEP
                    slopes[k, ..., joint] = np.maximum(slopes[k, ..., joint], (1.0 + SPARE) * slope)
        return cls(slopes[0], slopes[1])

    def __call__(self, radius: Floats, speed: Floats) -> Floats:
        """The bound [N n], rad/s² or m/s².

        - `radius`: prediction error of q [N n], rad or m.
        - `speed`: prediction error of q̇ [N n], rad/s or m/s.
        """
        return np.einsum("kij,kj->ki", self.along_q, radius) + np.einsum("kij,kj->ki", self.along_dq, speed)
