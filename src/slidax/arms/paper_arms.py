"""The arms of the paper's examples: a planar two-link arm and a SCARA."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.core.parameter import parameter
from slidax.core.tracing import barrier
from slidax.core.types import Matrix, Scalar, Vector

from .arm import AbstractRobot, JointLimits, Payload
from .articulated import Articulated


def _point_masses(
    robot: TwoLink | Scara,
    turns: Array,
    places: Array,
    centers: Array,
    armature: Array,
    down: Sequence[float],
) -> Articulated:
    """Return a chain with one point mass for each link.

    - `turns`, `places`: each joint's axes and position in the previous joint's frame [n 3 3], [n 3].
    - `centers`: position of each mass in its joint's frame; the last is also the tip's [n 3].
    - `armature`: rotor inertias [n].
    - `down`: direction of gravity [3].
    """
    n = robot.joints
    nothing, unlimited = jnp.zeros(n), jnp.full(n, jnp.inf)
    return Articulated(
        rotations=turns,
        translations=places,
        masses=robot.masses,
        centers=centers,
        inertias=jnp.zeros((n, 3, 3)),
        armature=armature,
        viscous=nothing,
        coulomb=nothing,
        smoothing=jnp.ones(()),
        gravity_vector=robot.gravity_acceleration * jnp.asarray(down),
        tip_rotation=jnp.eye(3),
        tip_translation=centers[-1],
        payload=Payload(),
        limits=JointLimits(-unlimited, unlimited, unlimited, unlimited, unlimited),
        name=robot.title,
        joint_names=robot.joint_names,
        link_names=tuple(f"link {k + 1}" for k in range(n)),
        parents=tuple(range(-1, n - 1)),
        tip_joint=n - 1,
        joint_units=robot.joint_units,
    )


class TwoLink(AbstractRobot):
    """Two revolute joints in a vertical plane, link masses at the link ends, with link inertias.

    With `a = (m1 + m2) l1² + m2 l2² + I1`, `b = m2 l2²`, `c = m2 l1 l2`, `h = c sin q2`:
    `M = [a + 2c cos q2, b + c cos q2; b + c cos q2, b + I2]`,
    `C = [-h q̇2, -h (q̇1 + q̇2); h q̇1, 0]`,
    `G = [(m1 + m2) l1 g cos q1 + m2 l2 g cos(q1 + q2), m2 l2 g cos(q1 + q2)]`.

    Source: the benchmark arm that the paper cites as [45] and does not print; this is its standard form. The
    eigenvalues of `M⁻¹`, 0.089 to 0.197 for the paper's parameters, explain the paper's bounds 0.09 and 0.2. `I1` and
    `I2` are on the diagonal only, so they act like rotor inertias of their joints.
    """

    title = "The planar two-link arm of Example 4.1."

    lengths: Float[Array, "2"] = parameter("link lengths l1, l2", "m", "> 0")
    masses: Float[Array, "2"] = parameter("link masses m1, m2", "kg", "> 0")
    inertias: Float[Array, "2"] = parameter("link inertias I1, I2", "kg m²", ">= 0")
    gravity_acceleration: Scalar = parameter(
        "g, acceleration of gravity", "m/s²", default=9.8, source="the paper's [45]"
    )

    joint_units: ClassVar[tuple[str, ...]] = ("rad", "rad")  # type: ignore[misc]  # every such arm has them
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1", "joint 2")  # type: ignore[misc]

    def mass(self, q: Vector) -> Matrix:
        m1, m2 = self.masses
        l1, l2 = self.lengths
        i1, i2 = self.inertias
        b = m2 * l2 * l2
        c = m2 * l1 * l2 * barrier(jnp.cos(q[1]))
        m11 = (m1 + m2) * l1 * l1 + b + 2.0 * c + i1
        return jnp.array([[m11, b + c], [b + c, b + i2]])

    def bias(self, q: Vector, dq: Vector) -> Vector:
        m1, m2 = self.masses
        l1, l2 = self.lengths
        g = self.gravity_acceleration
        cos1, sin1 = barrier((jnp.cos(q[0]), jnp.sin(q[0])))
        cos2, sin2 = barrier((jnp.cos(q[1]), jnp.sin(q[1])))
        h = m2 * l1 * l2 * sin2
        # cos(q1 + q2), without another call of the cosine.
        g2 = m2 * l2 * g * (cos1 * cos2 - sin1 * sin2)
        g1 = (m1 + m2) * l1 * g * cos1 + g2
        return jnp.array([g1 - h * dq[1] * (2.0 * dq[0] + dq[1]), g2 + h * dq[0] * dq[0]])

    def friction(self, dq: Vector) -> Vector:
        return jnp.zeros_like(dq)

    def potential(self, q: Vector) -> Scalar:
        m1, m2 = self.masses
        l1, l2 = self.lengths
        height1 = l1 * jnp.sin(q[0])
        return self.gravity_acceleration * ((m1 + m2) * height1 + m2 * l2 * jnp.sin(q[0] + q[1]))

    def tip(self, q: Vector) -> Float[Array, "3"]:
        """Return the end of the second link, [3], m; the arm moves in the x-y plane, y up."""
        l1, l2 = self.lengths
        x = l1 * jnp.cos(q[0]) + l2 * jnp.cos(q[0] + q[1])
        y = l1 * jnp.sin(q[0]) + l2 * jnp.sin(q[0] + q[1])
        return jnp.array([x, y, jnp.zeros_like(x)])

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the tip's axes, as columns, x along the second link, and its position, [3 3] and [3], m."""
        c, s = jnp.cos(q[0] + q[1]), jnp.sin(q[0] + q[1])
        zero, unit = jnp.zeros_like(c), jnp.ones_like(c)
        return jnp.array([[c, -s, zero], [s, c, zero], [zero, zero, unit]]), self.tip(q)

    def rigid_links(self) -> Articulated:
        """Return the same arm as an `Articulated` chain of rigid links, with I1 and I2 as rotor inertias."""
        l1, l2 = self.lengths
        places = jnp.array([[0.0, 0.0, 0.0], [l1, 0.0, 0.0]])
        centers = jnp.array([[l1, 0.0, 0.0], [l2, 0.0, 0.0]])
        return _point_masses(
            self, jnp.array([jnp.eye(3), jnp.eye(3)]), places, centers, self.inertias, [0.0, -1.0, 0.0]
        )


class Scara(AbstractRobot):
    """A SCARA arm with point masses at the link ends; the prismatic axis points down.

    With `a = (m1 + m2 + m3) l1²`, `b = (m2 + m3) l2²`, `c = (m2 + m3) l1 l2`:
    `M = [a + 2c cos q2 + b, b + c cos q2, 0; b + c cos q2, b, 0; 0, 0, m3]`,
    `C = [-c sin(q2) q̇2, -c sin(q2) (q̇1 + q̇2), 0; c sin(q2) q̇1, 0, 0; 0, 0, 0]`, `G = [0, 0, -m3 g]`.

    Identified, not sourced: the paper cites the arm's model as [46] and does not print it. Among some 35 tested
    variants, this arm fits the printed results best.
    """

    title = "The three-joint arm of Example 4.2: two revolute joints and a prismatic one."

    lengths: Float[Array, "2"] = parameter("link lengths l1, l2", "m", "> 0")
    masses: Float[Array, "3"] = parameter("masses m1, m2, m3", "kg", "> 0")
    gravity_acceleration: Scalar = parameter(
        "g, acceleration of gravity", "m/s²", default=9.8, source="as in Example 4.1"
    )

    joint_units: ClassVar[tuple[str, ...]] = ("rad", "rad", "m")  # type: ignore[misc]  # every such arm has them
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1", "joint 2", "joint 3")  # type: ignore[misc]

    def mass(self, q: Vector) -> Matrix:
        m1, m2, m3 = self.masses
        l1, l2 = self.lengths
        a = (m1 + m2 + m3) * l1 * l1
        b = (m2 + m3) * l2 * l2
        c = (m2 + m3) * l1 * l2 * barrier(jnp.cos(q[1]))
        zero = jnp.zeros_like(c)
        return jnp.array([[a + 2.0 * c + b, b + c, zero], [b + c, b, zero], [zero, zero, m3]])

    def bias(self, q: Vector, dq: Vector) -> Vector:
        _, m2, m3 = self.masses
        l1, l2 = self.lengths
        h = (m2 + m3) * l1 * l2 * barrier(jnp.sin(q[1]))
        return jnp.array([-h * dq[1] * (2.0 * dq[0] + dq[1]), h * dq[0] * dq[0], -m3 * self.gravity_acceleration])

    def friction(self, dq: Vector) -> Vector:
        return jnp.zeros_like(dq)

    def potential(self, q: Vector) -> Scalar:
        """Return the potential energy, J: the last link falls as q3 grows."""
        return -self.masses[2] * self.gravity_acceleration * q[2]

    def tip(self, q: Vector) -> Float[Array, "3"]:
        """Return `x = l1 cos q1 + l2 cos(q1+q2)`, `y = l1 sin q1 + l2 sin(q1+q2)`, `z = -q3`, [3], m."""
        l1, l2 = self.lengths
        x = l1 * jnp.cos(q[0]) + l2 * jnp.cos(q[0] + q[1])
        y = l1 * jnp.sin(q[0]) + l2 * jnp.sin(q[0] + q[1])
        return jnp.array([x, y, -q[2]])

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the tip's axes, as columns, x along the second link, and its position, [3 3] and [3], m."""
        c, s = jnp.cos(q[0] + q[1]), jnp.sin(q[0] + q[1])
        zero, unit = jnp.zeros_like(c), jnp.ones_like(c)
        return jnp.array([[c, -s, zero], [s, c, zero], [zero, zero, unit]]), self.tip(q)

    def rigid_links(self) -> Articulated:
        """Return the same arm as an `Articulated` chain of rigid links, but with the z axis of the tip's frame down."""
        l1, l2 = self.lengths
        turns = jnp.array([jnp.eye(3), jnp.eye(3), jnp.diag(jnp.array([1.0, -1.0, -1.0]))])
        places = jnp.array([[0.0, 0.0, 0.0], [l1, 0.0, 0.0], [l2, 0.0, 0.0]])
        centers = jnp.array([[l1, 0.0, 0.0], [l2, 0.0, 0.0], [0.0, 0.0, 0.0]])
        return _point_masses(self, turns, places, centers, jnp.zeros(3), [0.0, 0.0, -1.0])
