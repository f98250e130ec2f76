"""Simple schemes and plants with known behaviour, for tests of the loop alone."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax.arms import AbstractRobot
from slidax.core.types import Command, Envelope
from slidax.law import AbstractController
from slidax.plant import Harmonic
from slidax.simulation import Plant
from tests.paper_examples import TWO_LINK


class Spring(AbstractController):
    """`τ = -stiffness e - damping ė`: smooth, without an envelope; counts its samples in its memory."""

    stiffness: jax.Array
    damping: jax.Array
    joints: int = eqx.field(static=True, default=2)

    def init(self, t, state, reference):
        return jnp.zeros(())

    def __call__(self, t, state, reference_now, reference_next, memory):
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        ahead = reference_next.q - reference_now.q
        tau = -self.stiffness * e - self.damping * de
        return Command(tau=tau, memory=memory + 1.0, signals={"count": memory, "ahead": ahead})

    def envelope(self, t, memory):
        return None


class AroundSpring(AbstractController):
    """A law that has a spring, which counts in its memory."""

    spring: Spring

    @property
    def joints(self):
        return self.spring.joints

    def init(self, t, state, reference):
        return self.spring.init(t, state, reference)

    def __call__(self, t, state, reference_now, reference_next, memory):
        return self.spring(t, state, reference_now, reference_next, memory)

    def envelope(self, t, memory):
        return None


class BoundedLaw(AroundSpring):
    """A spring whose error must stay within a constant radius."""

    radius: jax.Array

    def envelope(self, t, memory):
        wide = self.radius * jnp.ones(self.joints)
        return Envelope(lower=-wide, upper=wide)


class Witness(AroundSpring):
    """A spring that records the state, the first state and the number of its calls."""

    def init(self, t, state, reference):
        return self.spring.init(t, state, reference), state.q

    def __call__(self, t, state, reference_now, reference_next, memory):
        count, first = memory
        command = self.spring(t, state, reference_now, reference_next, count)
        signals = {"q": state.q, "dq": state.dq, "first": first, "count": count}
        return Command(tau=command.tau, memory=(command.memory, first), signals=signals)


class Pendulum(AbstractRobot):
    """`2 q̈ + 3 sin q = τ`, one joint."""

    joint_units: ClassVar[tuple[str, ...]] = ("rad",)
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1",)

    def mass(self, q):
        return 2.0 * jnp.eye(1)

    def bias(self, q, dq):
        return 3.0 * jnp.sin(q)

    def friction(self, dq):
        return jnp.zeros_like(dq)

    def potential(self, q):
        return -3.0 * jnp.cos(q[0])

    def tip(self, q):
        return jnp.stack([jnp.sin(q[0]), jnp.zeros(()), -jnp.cos(q[0])])


class FreeMass(AbstractRobot):
    """A mass on a line without gravity, whose motion under a held force is known exactly."""

    size: jax.Array = eqx.field(converter=jnp.asarray, default=1.0)
    joint_units: ClassVar[tuple[str, ...]] = ("m",)
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1",)

    def mass(self, q):
        return self.size * jnp.ones((1, 1))

    def bias(self, q, dq):
        return jnp.zeros(1)

    def friction(self, dq):
        return jnp.zeros_like(dq)

    def potential(self, q):
        return jnp.zeros(())

    def tip(self, q):
        return jnp.array([q[0], 0.0, 0.0])


class Breaks(AroundSpring):
    """A spring whose torque at one joint is NaN from a time on."""

    when: jax.Array
    joint: int = eqx.field(static=True)

    def __call__(self, t, state, reference_now, reference_next, memory):
        command = self.spring(t, state, reference_now, reference_next, memory)
        broken = (jnp.arange(self.joints) == self.joint - 1) & (t >= self.when)
        return eqx.tree_at(lambda c: c.tau, command, jnp.where(broken, jnp.nan, command.tau))


SPRING = Spring(jnp.array([300.0, 150.0]), jnp.array([40.0, 25.0]))
SMOOTH_PLANT = Plant(TWO_LINK, Harmonic([2.0, 1.0], [1.0, 2.0], [0.0, 0.5]))
