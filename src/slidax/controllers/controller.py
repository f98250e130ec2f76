"""Base class of all controllers."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from slidax._types import Command, Envelope, Reference
from slidax.parts import AbstractPart, Memory, Scalar, State

from .steps import AbstractStep, Recovery


class AbstractController(AbstractPart):
    """A pure function from measurements to a torque, with explicit memory. It never sees the plant."""

    plans: ClassVar[bool] = False
    """True if its sampled-data form plans over a horizon, by an `implicit_step`."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """Number of joints that it commands."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """Return the memory at the start, any pytree of arrays.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: desired motion of the joints then.
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
        """Return the law as an implicit step over a horizon, for `sampled_data`; None if it has no such form.

        - `recovery`: policy outside the envelope.
        - `slopes`: True if the bound of a robust torque counts the slope part of τ1, as printed in (45).
        """
        return None
