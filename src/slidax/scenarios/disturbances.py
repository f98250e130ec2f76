"""Disturbances in a scenario file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from slidax._errors import located
from slidax.disturbances import AbstractDisturbance, Sum

from .base import AbstractDescription, said
from .derived import PartDescription, union_of

if TYPE_CHECKING:
    Term = PartDescription
else:
    Term = union_of(AbstractDisturbance)


class DisturbanceDescription(AbstractDescription):
    """The disturbance from outside: the sum of the terms, times the scale."""

    scale: float = said("factor on all terms; 0 switches the disturbance off", default=1.0)
    terms: tuple[Term, ...] = ()
    """Terms of the sum."""

    def build(self) -> AbstractDisturbance:
        """Build the disturbance."""
        built = []
        for number, term in enumerate(self.terms):
            with located(f"terms.{number}"):
                built.append(term.build())
        return self.scale * Sum(tuple(built))
