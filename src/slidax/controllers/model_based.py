"""Base classes of controllers with a nominal arm, and of those with a sliding surface."""

from __future__ import annotations

from typing import ClassVar

from slidax._types import Envelope, Reference
from slidax.parts import Memory, Scalar, State, parameters_of, piece, require_joints, require_per_joint
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .controller import AbstractController


class AbstractModelBased(AbstractController):
    """A law that computes with a nominal arm; by default without an envelope and without a memory."""

    nominal: AbstractRobot = piece("the robot as the law knows it, M0, C0, G0")

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
    """A law with the sliding variable `s = ė + A e + pull(ε1)` of (40)."""

    plans: ClassVar[bool] = True

    transformation: AbstractTransformation = piece("e to ε1, with A and B")
    surface: AbstractSurface = piece("the pull on ε1")

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return self.transformation.init(t, state.q - reference.q)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.transformation.envelope(t, memory)
