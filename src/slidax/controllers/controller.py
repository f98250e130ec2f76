"""What every controller is."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from slidax._types import Command, Envelope, Reference
from slidax.parts import AbstractPart, Memory, Scalar, State

from .steps import AbstractStep, Recovery


class AbstractController(AbstractPart):
    """A pure function from what is measured to a torque, with explicit memory. It never sees the plant."""

    plans: ClassVar[bool] = False
    """Whether its sampled-data form plans over a horizon, by an `implicit_step`."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """The number of joints it commands."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """The memory at the start: any pytree of arrays.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """

    @abstractmethod
    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The torque at one sample, with the memory after it.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: the memory before this sample.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The bounds that the error must keep, or None for a scheme that promises none.

        - `t`: time [s].
        - `memory`: the memory.
        """

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep | None:
        """The law as an implicit step over a horizon, for `sampled_data`; None for a law that has no such form.

        - `recovery`: what to do outside the envelope.
        - `slopes`: whether the size of a robust torque counts the slope part of τ1, as (45) prints it.
        """
        return None
