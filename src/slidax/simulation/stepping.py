"""Stepping of a closed loop: period, mode, integrator, engine, and the action at a violated envelope or joint limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from operator import index
from typing import Any, Literal, get_args, get_type_hints

from slidax.core.errors import DefinitionError, is_traced, nearest_word, short_repr
from slidax.core.integrators import runge_kutta_4
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart

from .engine import EngineName
from .loop import Integrator


def _known_period(period: Any) -> float:
    if is_traced(period):
        raise DefinitionError("`period` sets the number of samples: it must be a number, not traced by `jit` or `vmap`")
    return float(period)


class Stepping(AbstractPart):
    """Period, mode and integrator of a closed loop.

    In mode "held" the law is evaluated once per period, its torque is held, and the plant takes `substeps` steps of
    the integrator. In mode "continuous" the law is evaluated at every stage of the integrator, whose step is the
    period. `simulate` and similar functions take a `Stepping`, its fields as keywords, or both: keywords take
    precedence.
    """

    period: float = parameter("time between samples", "s", "> 0", static=True, converter=_known_period)
    mode: Literal["held", "continuous"] = piece('"held" or "continuous"', default="held", static=True)
    substeps: int = parameter(
        "integrator steps per period in held mode", "", "[1, 10000]", default=1, static=True, converter=index
    )
    integrator: Integrator = piece(
        "`slidax.core.runge_kutta_4` or `semi_implicit_euler`; a `MujocoPlant` has its own",
        default=runge_kutta_4,
        static=True,
    )
    outside: Literal["raise", "recover"] = piece(
        'action at a sample outside the envelope: "raise" ends the run; "recover" counts it and continues (held mode)',
        default="raise",
        static=True,
    )
    limits: Literal["check", "ignore"] = piece(
        'action at a start or a motion beyond the joint limits: "check" raises an error; "ignore" runs it',
        default="check",
        static=True,
    )
    engine: EngineName = piece(
        'engine: "native" for slidax\'s own machine code, "xla" for JAX\'s compiler, "auto" for "native" if possible, '
        '"cuda" for the native code on an NVIDIA GPU, for batches',
        default="auto",
        static=True,
    )

    def __check_init__(self) -> None:
        for name, kind in get_type_hints(type(self)).items():
            choices, value = get_args(kind), getattr(self, name)
            if name in CHOICES and value not in choices:
                listed = ", ".join(f"`{choice}`" for choice in choices)
                raise DefinitionError(f"`Stepping.{name}` must be one of {listed}; got {short_repr(value)}")
        if self.mode == "continuous" and self.substeps != 1:
            raise DefinitionError(
                f"`Stepping.substeps` must be 1 in continuous mode, where `period` is the step; got {self.substeps}"
            )
        if self.mode == "continuous" and self.outside == "recover":
            raise DefinitionError("`Stepping.outside` must be `raise` in continuous mode: recovering needs samples")

    @staticmethod
    def of(stepping: Stepping | None, changes: Mapping[str, Any]) -> Stepping:
        """Return `stepping` with some fields replaced, or a new `Stepping` from the fields if `stepping` is None.

        - `changes`: values of the fields by name.

        Raises DefinitionError if a field is unknown or out of its range, or the period is missing.
        """
        names = [field.name for field in fields(Stepping)]
        unknown = set(changes) - set(names)
        if unknown:
            name = min(unknown)
            raise DefinitionError(f"there is no argument `{name}`; {nearest_word(name, names)}")
        if stepping is not None:
            return replace(stepping, **changes) if changes else stepping
        if "period" not in changes:
            raise DefinitionError("`period`, the time between samples [s], must be given")
        return Stepping(**changes)


CHOICES = ("mode", "outside", "limits", "engine")
"""Fields whose value is one of a few words."""
