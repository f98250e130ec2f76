"""Named schemes: controllers with their parts, such as surface and reaching law, and parameter values."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import equinox as eqx

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, locate_errors, nearest_word
from slidax.core.parameter import Parameter, parameters_of

from .controllers import AbstractController
from .error_transformations import PrescribedPerformance, Unconstrained
from .linear_controllers import ComputedTorque, GravityCompensatedPD, JointPID
from .reaching_laws import FixedTimeReaching, TwoPowerReaching
from .sliding_mode_controllers import (
    AdaptiveNonsingularFastTerminal,
    NonsingularFastTerminal,
    SlidingMode,
    SlotineLi,
    SuperTwisting,
)
from .surfaces import Linear, LinearCoreFixedTime, SingularityFree, SmoothFixedTime
from .torque_bounds import StateBound, UncertaintyBound


class PresetPart:
    """A part of a preset, such as its surface, with the preset's values of the part's parameters.

    - `part`: class of the part.
    - `values`: parameter values by name. A call of the preset must contain the missing ones.
    """

    def __init__(self, part: type[eqx.Module], **values: Any) -> None:
        self.part = part
        self.values = values

    def __repr__(self) -> str:
        return f"{self.part.__name__}({', '.join(f'{name}={value}' for name, value in self.values.items())})"


class Preset:
    """A published or usual scheme: a law with parts and parameter values. A call with a robot returns the controller.

        law = cftsmppc(nominal, performance=FixedTime(1.0, 0.01, 2.0, 3.0), overshoot=0.2, bound=bound, k1=0.3)

    A keyword argument is a parameter or a part of the law, such as its surface, or a mapping of parameters for a part.
    The name of the part may be left out if no other part has such a parameter: `k1=0.3` is then `surface={"k1": 0.3}`.
    A part of another class replaces the preset's.

    - `law`: the class of the controller.
    - `title`: one line, then a longer description.
    - `source`: source of the values.
    - `values`: parameter values, and parts as `PresetPart`, by the law's field names.
    """

    def __init__(self, law: type[AbstractController], title: str, *, source: str = "", **values: Any) -> None:
        self.law = law
        self.title = title
        self.source = source
        self.values: dict[str, Any] = values
        parameters = self._own()
        listed = [f"- `{parameter.name}`: {parameter.meaning}." for parameter in parameters]
        kinds = inspect.Parameter
        named = [kinds(p.name, kinds.KEYWORD_ONLY, default=values.get(p.name)) for p in parameters]
        self.__signature__ = inspect.Signature([kinds("nominal", kinds.POSITIONAL_OR_KEYWORD), *named])
        self.__doc__ = "\n".join([inspect.cleandoc(title), "", "- `nominal`: the robot as the law knows it.", *listed])

    def __call__(self, nominal: AbstractRobot, **values: Any) -> AbstractController:
        """Return the controller.

        - `nominal`: the robot as the law knows it.
        - `values`: parts and parameters that the preset lacks, or that replace its own.

        Raises DefinitionError if a value is missing, unknown, out of its range or does not fit the joints.
        """
        placed = self.placed(values)
        parts: dict[str, Any] = {}
        for name in {**self.values, **placed}:
            value, preset = placed.get(name, {}), self.values.get(name)
            if isinstance(preset, PresetPart) and isinstance(value, Mapping):
                with locate_errors(name):
                    parts[name] = _build(preset.part, {**preset.values, **value})
            else:
                parts[name] = placed.get(name, preset)
        return _build(self.law, {"nominal": nominal, **parts})

    def placed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values by field of the law: `{"k1": 0.3}` becomes `{"surface": {"k1": 0.3}}`.

        - `values`: values by field of the law, or by a parameter that only one of its parts has.

        Raises DefinitionError for a name that no part has, or that several parts have.
        """
        own = {parameter.name for parameter in self._own()}
        placed: dict[str, Any] = {name: value for name, value in values.items() if name in own}
        for name, value in values.items():
            if name in own:
                continue
            owners = self.owners(name)
            if len(owners) != 1:
                if owners:
                    raise DefinitionError(
                        f"`{name}` is a parameter of {' and of '.join(owners)}: name the part, as in "
                        f'`{owners[0]}={{"{name}": ...}}`'
                    )
                known = own.union(*(_names(part) for part in self._parts().values()))
                raise DefinitionError(f"the law has no parameter or part `{name}`; {nearest_word(name, sorted(known))}")
            part = placed.setdefault(owners[0], {})
            if not isinstance(part, Mapping):
                raise DefinitionError(
                    f"`{name}` is a parameter of `{owners[0]}`, which the call replaces as well: leave one out"
                )
            placed[owners[0]] = {**part, name: value}
        return placed

    @property
    def complete(self) -> bool:
        """True if the preset has every required field of its law; parameters of the parts may be missing."""
        return all(parameter.name in self.values for parameter in self._own() if parameter.required)

    def owners(self, name: str) -> list[str]:
        """Return the field names of the preset's parts that have a parameter of this name."""
        return [field for field, part in self._parts().items() if name in _names(part)]

    def _own(self) -> list[Parameter]:
        return [parameter for parameter in parameters_of(self.law) if parameter.name != "nominal"]

    def _parts(self) -> dict[str, type[eqx.Module]]:
        return {name: value.part for name, value in self.values.items() if isinstance(value, PresetPart)}


def _names(part: type) -> set[str]:
    return {parameter.name for parameter in parameters_of(part)}


def _build(part: type, values: dict[str, Any]) -> Any:
    missing = [p.name for p in parameters_of(part) if p.required and p.name not in values]
    if missing:
        raise DefinitionError(f"`{part.__name__}` needs {' and '.join(f'`{name}`' for name in missing)}")
    return part(**values)


cftsmppc = Preset(
    SlidingMode,
    """Approximate continuous fixed-time terminal sliding mode with prescribed performance (CFTSMPPC), the paper's own.

    Eqs. (40)-(45) of the paper with the boundary layer (51), the fixed-time envelope (20) and the smooth surface (29).
    Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w.
    """,
    source="Table 1",
    transformation=PresetPart(PrescribedPerformance),
    surface=PresetPart(SmoothFixedTime, k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01),
    reaching=PresetPart(FixedTimeReaching, gain=0.1, exponent=1.2, layer=0.05),
    bound=PresetPart(UncertaintyBound),
)


ftsmppc = Preset(
    SlidingMode,
    """Fixed-time terminal sliding mode with prescribed performance (FTSMPPC), the paper's [33].

    CFTSMPPC with `ŝ^p` of (78) in place of the smooth `s^p` of (29). The paper prints its parameters, not its law:
    reconstructed, with medium confidence.
    """,
    source="Table 1",
    transformation=PresetPart(PrescribedPerformance),
    surface=PresetPart(LinearCoreFixedTime, k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01),
    reaching=PresetPart(FixedTimeReaching, gain=0.1, exponent=1.2, layer=0.05),
    bound=PresetPart(UncertaintyBound),
)


ftsmc = Preset(
    SlidingMode,
    """Fixed-time terminal sliding mode without an envelope (FTSMC), the paper's [23].

    `s = ė + K1 Ŝ^p(e) + K2 Sig^q(e)` with `ŝ^p` of (78); `u = (k + b0 + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, without b1. The
    paper prints its parameters, not its law: the form follows from (34)-(47), (78), (79); reconstructed, with
    medium confidence in the details. Table 1 lists no boundary layer, hence the unit vector; but the paper's figure 4
    looks like a run with `layer=0.05`.
    """,
    source="Table 1",
    transformation=PresetPart(Unconstrained),
    surface=PresetPart(LinearCoreFixedTime, k1=1.5, k2=1.0, p=0.5, q=1.2, delta=0.01),
    reaching=PresetPart(FixedTimeReaching, gain=1.0, exponent=1.2, layer=0.0),
    bound=PresetPart(UncertaintyBound, b1=0.0),
)


sfsmc = Preset(
    SlidingMode,
    """Singularity-free fixed-time sliding mode (SFSMC), the paper's [24].

    `s = ė + C1 S_α(e) + C2 Sig^β(e)`; `u = (k + a0 + a1‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, a0 as b0 and a1 as b2: the law
    has no b1. The paper prints its parameters, not its law: reconstructed, with medium confidence. In Example 4.2 the
    first torque of joint 3 is 44.4 N, where the paper prints 45.37 N.
    """,
    source="Table 2",
    transformation=PresetPart(Unconstrained),
    surface=PresetPart(SingularityFree, c1=2.0, c2=2.0, alpha=0.7, beta=1.9, r=1.7, delta=0.3),
    reaching=PresetPart(TwoPowerReaching, k1=5.0, k2=5.0, v1=2.5, v2=0.5, layer=0.0),
    bound=PresetPart(UncertaintyBound, b1=0.0),
)

sfsmppc = Preset(
    SlidingMode,
    "The singularity-free scheme inside an envelope; the gains of the surface are our own, after Table 1's CFTSMPPC.",
    source="our choice",
    transformation=PresetPart(PrescribedPerformance),
    surface=PresetPart(SingularityFree, c1=0.2, c2=0.6, alpha=0.7, beta=1.2, r=1.7, delta=0.3),
    reaching=PresetPart(TwoPowerReaching, k1=5.0, k2=5.0, v1=2.5, v2=0.5, layer=0.05),
    bound=PresetPart(UncertaintyBound, b1=0.0),
)


nftsmc = Preset(
    NonsingularFastTerminal,
    "Nonsingular fast terminal sliding mode, the paper's [7].",
    source="Table 2",
    bound=PresetPart(StateBound),
    gamma1=2.0,
    gamma2=5.0 / 3.0,
    reach=2.0,
    gain=2.0,
    layer=0.0,
)

anftsmc = Preset(
    AdaptiveNonsingularFastTerminal,
    """Adaptive nonsingular fast terminal sliding mode, the paper's [10].

    α comes from a follow-up paper: with the 0.2 of Table 2 the law is singular.
    """,
    source="Table 2",
    k1=1.0,
    k2=1.0,
    alpha=2.0,
    beta=5.0 / 3.0,
    gain=250.0,
    margin=0.5,
    adaptation=(0.01, 0.01, 0.01),
    initial=(0.0, 0.0, 0.0),
    layer=0.0,
)


OURS = "our choice"

sliding_mode = Preset(SlidingMode, "The paper's law (41)-(45), with any surface, envelope, reaching law and bound.")

slotine_li = Preset(
    SlotineLi,
    "The classical sliding mode law with a boundary layer (Slotine and Li).",
    source=OURS,
    transformation=PresetPart(Unconstrained),
    surface=PresetPart(Linear, rate=5.0),
    damping=20.0,
    gain=20.0,
    layer=0.05,
)

slotine_li_ppc = Preset(
    SlotineLi,
    "The classical sliding mode law inside an envelope.",
    source=OURS,
    transformation=PresetPart(PrescribedPerformance),
    surface=PresetPart(Linear, rate=0.6),
    damping=20.0,
    gain=20.0,
    layer=0.05,
)

super_twisting = Preset(
    SuperTwisting,
    """Super-twisting on a linear surface (Levant; Moreno and Osorio).

    For a disturbance whose rate is at most L [rad/s³]: `k1 = 1.5 √L`, `k2 = 1.1 L`.
    """,
    source=OURS,
    transformation=PresetPart(Unconstrained),
    surface=PresetPart(Linear, rate=5.0),
    k1=12.0,
    k2=70.0,
)

computed_torque = Preset(
    ComputedTorque,
    """Computed torque with PD feedback.

    In sampled-data form the estimator makes it computed torque with a disturbance observer.
    """,
    source=OURS,
    kp=100.0,
    kd=20.0,
)

gravity_pd = Preset(GravityCompensatedPD, "PD feedback with gravity compensation.", source=OURS, kp=400.0, kd=100.0)

pid = Preset(
    JointPID,
    """A PID controller at each joint, which knows nothing of the arm.

    As in usual drives: no model and no feed-forward. The integral stops at the torque limit of the drives.
    """,
    source=OURS,
    kp=400.0,
    ki=800.0,
    kd=100.0,
    gravity=0.0,
)
