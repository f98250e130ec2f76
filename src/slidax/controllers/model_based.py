"""What the laws that know a nominal arm have in common."""

from __future__ import annotations

from typing import ClassVar

from slidax._types import Envelope, Reference
from slidax.parts import Memory, Scalar, State, parameters_of, piece, require_joints, require_per_joint
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .controller import AbstractController


class AbstractModelBased(AbstractController):
    """A law that computes with a nominal arm; without an envelope or a memory, unless it says otherwise."""

    nominal: AbstractRobot = piece("the robot as the law knows it, M0, C0, G0")

    def __check_init__(self) -> None:
        of = type(self.nominal).__name__
        for said in parameters_of(type(self)):
            if said.piece and said.name != "nominal":
                require_joints(getattr(self, said.name), self.joints, of)
            elif said.shape == "one number or [n]":
                require_per_joint(self, self.joints, of, said.name)

    @property
    def joints(self) -> int:
        """The number of joints of the nominal robot."""
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """Nothing to keep.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        return ()

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """None: no bounds are promised.

        - `t`: time [s].
        - `memory`: the memory.
        """
        return None


class AbstractSurfaceBased(AbstractModelBased):
    """A law with the sliding variable `s = ė + A e + pull(ε1)` of (40)."""

    plans: ClassVar[bool] = True

    transformation: AbstractTransformation = piece("e to ε1, with A and B")
    surface: AbstractSurface = piece("the pull on ε1")

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """What the transformation keeps from the initial error.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        return self.transformation.init(t, state.q - reference.q)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The transformation's envelope.

        - `t`: time [s].
        - `memory`: what `init` returned.
        """
        return self.transformation.envelope(t, memory)
