"""How a true arm differs from the nominal one that its law knows."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import DefinitionError, as_array, known, require
from slidax._types import PerJoint, Vector

from .articulated import Articulated
from .load import Load


def _maybe(value: Any) -> Any:
    return None if value is None else as_array(value)


class Mismatch(eqx.Module):
    """The true arm: the nominal one with other masses, other friction, and something at its tip.

    - `mass`: factor on the links' masses, one number or [n], > 0: .85 is an arm 15 % lighter than its law believes.
    - `inertia`: factor on their inertias about the centres of mass; as `mass` if not given.
    - `viscous`, `coulomb`: friction in place of the nominal arm's, one number or [n]; as there if not given.
    - `armature`: inertia of the rotors in place of the nominal arm's; as there if not given.
    - `load`: what the tip carries, and when; None for nothing.

    Raises DefinitionError if one of them is out of its range.
    """

    mass: PerJoint = eqx.field(converter=as_array, default=1.0)
    inertia: PerJoint | None = eqx.field(converter=_maybe, default=None)
    viscous: PerJoint | None = eqx.field(converter=_maybe, default=None)
    coulomb: PerJoint | None = eqx.field(converter=_maybe, default=None)
    armature: PerJoint | None = eqx.field(converter=_maybe, default=None)
    load: Load | None = None

    def __check_init__(self) -> None:
        for field, least in (("mass", None), ("inertia", None), ("viscous", 0), ("coulomb", 0), ("armature", 0)):
            value = getattr(self, field)
            if value is not None:
                holds = known(value) > 0 if least is None else known(value) >= 0
                require(self, field, holds, "must be > 0" if least is None else "must be >= 0")

    def applied(self, nominal: Articulated) -> Articulated:
        """The true arm, without the load.

        - `nominal`: as the law knows it.

        Raises DefinitionError if a list has another length than the arm has joints.
        """
        inertia = self.mass if self.inertia is None else self.inertia
        true: Articulated = eqx.tree_at(
            lambda arm: (arm.masses, arm.inertias, arm.viscous, arm.coulomb, arm.armature),
            nominal,
            (
                nominal.masses * self._each("mass", self.mass, nominal),
                nominal.inertias * self._each("inertia", inertia, nominal)[:, None, None],
                nominal.viscous if self.viscous is None else self._each("viscous", self.viscous, nominal),
                nominal.coulomb if self.coulomb is None else self._each("coulomb", self.coulomb, nominal),
                nominal.armature if self.armature is None else self._each("armature", self.armature, nominal),
            ),
        )
        return true

    def _each(self, field: str, value: PerJoint, nominal: Articulated) -> Vector:
        if value.shape not in ((), (nominal.joints,)):
            raise DefinitionError(
                f"`Mismatch.{field}` must be one number or one for each of the {nominal.joints} joints of "
                f"{nominal.name}; got {value.shape[0]}"
            )
        each: Vector = jnp.broadcast_to(value, (nominal.joints,))
        return each
