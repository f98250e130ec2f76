"""Sets of values for a number of a scenario, each with a distribution."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
from pydantic import Discriminator, Field, Tag, field_validator
from pydantic_core import PydanticCustomError

from slidax._errors import DefinitionError, plain, shown

from ..base import AbstractDescription, Numbers, said
from .distribution import Cut, Distribution, cut_normal, shares
from .leaf import Array, Leaf

MOST_SEEDS = 2**32

EACH = "`joint` (or `entry`): a separate draw for each of its numbers; by default one draw for all of them"


class AbstractSet(AbstractDescription):
    """Base class of sets, which are images of the unit cube."""

    each: Literal["joint", "entry"] | None = Field(default=None, description=EACH)

    def coordinates(self, leaf: Leaf) -> int:
        """Return the number of coordinates of the unit cube that the set takes for a leaf."""
        return leaf.size if self.each else 1

    @property
    def example(self) -> Any:
        """A value of the set that does not depend on a leaf; None if there is none."""
        return None

    @abstractmethod
    def values(self, cube: Array, leaf: Leaf) -> Array:
        """Return the values of a leaf at points of the unit cube, [rows, ...].

        - `cube`: [rows, coordinates], in [0, 1).

        Raises DefinitionError if the set does not fit the leaf, or is empty.
        """

    def _spread(self, cube: Array, leaf: Leaf) -> Array:
        """The coordinates in the shape of the leaf, one for each number with a separate draw."""
        if self.each:
            return cube.reshape(len(cube), *leaf.shape_of_each)
        return cube.reshape(len(cube), *[1] * len(leaf.shape))


class Between(AbstractSet):
    """All values between two ends."""

    between: Annotated[list[Numbers], Field(min_length=2, max_length=2)]
    """Lower and upper end, each one number or one per joint."""
    distribution: Distribution = "uniform"
    """Distribution of the values."""
    mean: float | None = said("of `normal`", default=None, source="the middle")
    deviation: float | None = said("of `normal`", "", "> 0", default=None, source="a sixth of the width")

    @property
    def example(self) -> Any:
        return self.between[0]

    def values(self, cube: Array, leaf: Leaf) -> Array:
        lower, upper = (leaf.fitting(end, "between") for end in self.between)
        _require_order(lower, upper)
        if self.distribution != "normal" and (self.mean, self.deviation) != (None, None):
            raise DefinitionError(f"`mean` and `deviation` belong to `normal`, not to `{self.distribution}`")
        return shares(self._spread(cube, leaf), lower, upper, self.distribution, Cut(self.mean, self.deviation))


class Around(AbstractSet):
    """All values within a distance from the scenario's own."""

    around: float | str
    """The distance: a number in the parameter's unit, or a share of its own value, such as `20 %`."""
    distribution: Distribution = "uniform"
    """Distribution of the values."""

    @field_validator("around")
    @classmethod
    def _is_a_distance(cls, value: float | str) -> float | str:
        if isinstance(value, str):
            _share(value)
        elif not (np.isfinite(value) and value >= 0):
            raise PydanticCustomError("unknown_key", "must be >= 0 and finite; got {given}", {"given": shown(value)})
        return value

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("around")
        reach = np.abs(own) * _share(self.around) if isinstance(self.around, str) else self.around
        # One number for all joints may differ between the joints here.
        lower, upper = (leaf.spread_out(np.asarray(own + sign * reach), bool(self.each)) for sign in (-1.0, 1.0))
        return shares(self._spread(cube, leaf), lower, upper, self.distribution, Cut())


class Ball(AbstractSet):
    """All vectors within a distance from the scenario's own, such as a centre of mass."""

    ball: float = said("its radius, in the parameter's unit", "", ">= 0")
    distribution: Literal["uniform", "surface"] = "uniform"
    """`uniform` in the ball, or on its `surface`."""

    def coordinates(self, leaf: Leaf) -> int:
        """One for each number, and one for the distance."""
        return leaf.size + 1

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("ball").reshape(-1)
        direction = cut_normal(cube[:, :-1])
        # The middle of the cube has no direction; it is the middle of the ball.
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
        far = np.ones(len(cube)) if self.distribution == "surface" else cube[:, -1] ** (1.0 / leaf.size)
        return (own + self.ball * far[:, None] * direction).reshape(len(cube), *leaf.shape)


class Choice(AbstractSet):
    """A finite set of values."""

    choice: Annotated[list[float | list[float] | list[list[float]]], Field(min_length=1)] | Literal["any"]
    """The values; `any` for a seed."""
    weights: list[float] | None = None
    """Probabilities of the values; by default equal."""

    @property
    def example(self) -> Any:
        return 0 if self.choice == "any" else self.choice[0]

    def values(self, cube: Array, leaf: Leaf) -> Array:
        u = self._spread(cube, leaf)
        if self.choice == "any":
            if not leaf.integer:
                raise DefinitionError("`choice: any` is for seeds; write the values, or `between`")
            return np.floor(u * MOST_SEEDS).astype(int).reshape(len(cube), *leaf.shape)
        weights = self._weights(len(self.choice))
        edges = np.cumsum(weights)[:-1] / np.sum(weights)
        which = np.searchsorted(edges, u, side="right")
        fitting = [leaf.fitting(value, "choice") for value in self.choice]
        shape = np.broadcast_shapes(*(value.shape for value in fitting), leaf.shape_of_each if self.each else ())
        values = np.stack([np.broadcast_to(value, shape) for value in fitting])
        if leaf.integer and (values != np.round(values)).any():
            raise DefinitionError(f"needs whole numbers; got {shown(self.choice)}")
        picked: Array = np.take_along_axis(values[None], which.reshape(len(cube), 1, *u.shape[1:]), axis=1)[:, 0]
        return picked.astype(int) if leaf.integer else picked

    def _weights(self, count: int) -> Array:
        weights = np.ones(count) if self.weights is None else np.asarray(self.weights, float)
        if len(weights) != count or not (np.isfinite(weights) & (weights >= 0)).all() or not weights.sum() > 0:
            raise DefinitionError(f"`weights` must be {count} numbers >= 0, not all 0; got {shown(self.weights)}")
        return weights


class StandardError(AbstractSet):
    """Estimated values with a standard error, as from `slidax identify`: normal, cut at both sides."""

    standard_error: float | list[float] | list[list[float]]
    """One standard deviation of each number."""
    unit: str = ""
    """Unit of the number; not used."""
    seen: bool = True
    """True if the log excited the parameter; not used."""
    sigmas: float = said("where the normal distribution is cut, in standard errors", "", "(0, 8]", default=3.0)

    def coordinates(self, leaf: Leaf) -> int:
        """One for each number, as their errors are independent."""
        return int(np.prod(leaf.shape, dtype=int))

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("standard_error")
        error = np.broadcast_to(leaf.fitting(self.standard_error, "standard_error"), own.shape)
        if not (np.isfinite(error) & (error >= 0)).all():
            raise DefinitionError(f"`standard_error` must be >= 0 and finite; got {shown(self.standard_error)}")
        reach = cut_normal(cube.reshape(len(cube), *own.shape), self.sigmas)
        return np.clip(own + error * reach, *leaf.ends)


class Inside(AbstractSet):
    """Starts inside the envelope at t = 0, with the velocities of the scenario."""

    inside: Literal["envelope"]
    """The envelope around the starts."""
    share: float = said("of the distance from its middle to its bounds", "", "(0, 1)", default=0.9)
    each: Literal["joint", "entry"] | None = Field(default="joint", description="A separate draw for each joint.")

    def values(self, cube: Array, leaf: Leaf) -> Array:
        if leaf.envelope is None:
            raise DefinitionError("`inside` is for `start`")
        lower, upper = leaf.envelope()
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        return middle + self.share * half * (2.0 * self._spread(cube, leaf) - 1.0)


KINDS: dict[str, type[AbstractSet]] = {
    "between": Between,
    "around": Around,
    "ball": Ball,
    "choice": Choice,
    "standard_error": StandardError,
    "inside": Inside,
}


def _kind(data: Any) -> str | None:
    if isinstance(data, AbstractSet):
        return next(key for key, kind in KINDS.items() if type(data) is kind)
    keys = [key for key in KINDS if isinstance(data, dict) and key in data]
    return keys[0] if len(keys) == 1 else None


if TYPE_CHECKING:
    AnySet = AbstractSet
else:
    AnySet = Annotated[
        Union[tuple(Annotated[kind, Tag(key)] for key, kind in KINDS.items())],  # noqa: UP007
        Discriminator(
            _kind,
            custom_error_type="unknown_key",
            custom_error_message="needs one set of values: a mapping with one of " + ", ".join(f"`{k}`" for k in KINDS),
        ),
    ]


def _share(text: str) -> float:
    number, sign, rest = text.partition("%")
    try:
        share = float(number) / 100.0
    except ValueError:
        share = np.nan
    if not sign or rest.strip() or not (np.isfinite(share) and share >= 0):
        message = "must be a number, or a share >= 0 such as `20 %`; got `{given}`"
        raise PydanticCustomError("unknown_key", message, {"given": plain(text)})
    return share


def _require_order(lower: Array, upper: Array) -> None:
    if not (lower <= upper).all():
        raise DefinitionError(f"is empty: its lower end {shown(lower)} is above its upper end {shown(upper)}")
