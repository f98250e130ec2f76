"""Base classes of all controllers. The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import require_joints, require_per_joint
from slidax.core.parameter import parameters_of, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State

from .error_transformations import AbstractTransformation
from .steps import AbstractStep, Recovery
from .surfaces import AbstractSurface


class AbstractController(AbstractPart):
    """A pure function from measurements to a torque, with explicit memory. It has no access to the simulated plant."""

    plans: ClassVar[bool] = False
    """True if the sampled-data form of the law plans over a horizon, by an `implicit_step`."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """Number of joints that the law commands."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """Return the memory at the start, any pytree of arrays.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: desired motion of the joints at that time.
        """

    @abstractmethod
    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """Return the torque at one sample, with the memory after it.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: desired motion of the joints now and one period later.
        - `memory`: the memory before this sample.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """Return the bounds that the error must keep at time t [s]; None for a scheme without an envelope."""

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep | None:
        """Return the law as an implicit Euler step over a horizon, for `sampled_data`; None if it has no such form.

        - `recovery`: policy outside the envelope; None: return to the prescribed envelope.
        - `slopes`: the size u of the robust torque grows with the law's other torque τ0 + τ1, the paper's eq. (45).
          True includes in τ0 + τ1 the torque that keeps the sliding variable s constant, as the paper does. False
          leaves this torque out, so that u is smaller.
        """
        return None

    def at_period(self, period: Scalar) -> AbstractController:
        """Return the law with gains for a sampling period [s]; called only for laws without an implicit step."""
        return self


class AbstractModelBased(AbstractController):
    """A law that uses a nominal arm model; by default it has no envelope and no memory."""

    nominal: AbstractRobot = piece("the robot as the law knows it: inertia M0, Coriolis matrix C0, gravity torque G0")

    def __check_init__(self) -> None:
        robot = type(self.nominal).__name__
        for parameter in parameters_of(type(self)):
            if parameter.piece and parameter.name != "nominal":
                require_joints(getattr(self, parameter.name), self.joints, robot)
            elif parameter.shape == "one number or [n]":
                require_per_joint(self, self.joints, robot, parameter.name)

    @property
    def joints(self) -> int:
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return ()

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return None


class AbstractSurfaceBased(AbstractModelBased):
    """A law with the sliding variable `s = ė + A e + φ(ε1)` of the paper's eq. (40).

    e is the tracking error, ε1 the transformed error, and A the diagonal matrix of `TransformedError`.
    """

    plans: ClassVar[bool] = True

    transformation: AbstractTransformation = piece("error transformation from e to ε1")
    surface: AbstractSurface = piece("φ(ε1), the surface over the transformed error")

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return self.transformation.init(t, state.q - reference.q)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.transformation.envelope(t, memory)
