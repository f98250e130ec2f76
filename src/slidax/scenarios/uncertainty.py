"""Uncertainty of a scenario: sets of values for its parameters, with distributions."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Union

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator
from pydantic_core import PydanticCustomError

from slidax.arms.articulated import Articulated
from slidax.arms.mismatch import INERTIAL
from slidax.core.errors import DefinitionError, parse_number, plain_name, short_repr

from .descriptions import AbstractDescription, Numbers, input_field
from .uncertain_values import Array, Leaf
from .yaml_text import read_yaml_file

Distribution = Literal["uniform", "log_uniform", "triangular", "normal"]
"""`log_uniform`: uniform logarithm; `triangular`: peak in the middle; `normal`: truncated at both ends."""

TAIL = 1e-16
"""Smallest distance of a probability from 0 and from 1, where a normal distribution's quantile is infinite."""


class Cut(NamedTuple):
    """Mean and standard deviation of a normal distribution that is truncated at the two ends of a set.

    The defaults are the middle between the ends, and 1/6 of their distance.
    """

    mean: float | None = None
    deviation: float | None = None


def shares(u: Array, lower: Array, upper: Array, distribution: Distribution, cut: Cut) -> Array:
    """Return the quantiles of a distribution between two ends, at probabilities u in [0, 1).

    - `lower`, `upper`: the ends; they broadcast with u.
    - `cut`: mean and deviation of the distribution "normal"; not used for others.

    Raises DefinitionError if the distribution does not exist between these ends.
    """
    if distribution == "log_uniform":
        if not (lower > 0).all():
            raise DefinitionError(f"`log_uniform` needs ends > 0; got {short_repr(lower)}")
        values: Array = lower * (upper / lower) ** u
    elif distribution == "triangular":
        share = np.where(u < 0.5, np.sqrt(0.5 * u), 1.0 - np.sqrt(0.5 * (1.0 - u)))
        values = lower + (upper - lower) * share
    elif distribution == "normal":
        # Imported here, since few files need it and the import takes a third of a short command's start.
        from scipy.special import ndtr, ndtri

        mean = 0.5 * (lower + upper) if cut.mean is None else cut.mean
        width = (upper - lower) / 6.0 if cut.deviation is None else cut.deviation
        width = np.where(np.asarray(width) > 0, width, 1.0)
        low, high = ndtr((lower - mean) / width), ndtr((upper - mean) / width)
        values = mean + width * ndtri(np.clip(low + u * (high - low), TAIL, 1.0 - TAIL))
    else:
        values = lower + (upper - lower) * u
    # Rounding must not leave the set.
    return np.clip(values, lower, upper)


def truncated_normal(u: Array, sigmas: float = 8.0) -> Array:
    """Return quantiles of the standard normal distribution, truncated at ±`sigmas`, at probabilities u in [0, 1)."""
    from scipy.special import ndtr, ndtri

    low = ndtr(-sigmas)
    return ndtri(np.clip(low + u * (1.0 - 2.0 * low), TAIL, 1.0 - TAIL))


MOST_SEEDS = 2**32

EACH = "`joint` (or `entry`): a separate draw for each number; by default a single draw for all numbers"


class AbstractSet(AbstractDescription):
    """Base class of sets of values for one path of a scenario.

    A set maps points of a unit cube to values, so that random draws and grids need only points in [0, 1).
    """

    each: Literal["joint", "entry"] | None = Field(default=None, description=EACH)

    def coordinates(self, leaf: Leaf) -> int:
        """Return the dimension of the unit cube that the set maps to values.

        - `leaf`: the scenario's own value at the path of the set.
        """
        return leaf.size if self.each else 1

    @property
    def example(self) -> Any:
        """A value of the set, for a scenario without a value at this path; None if the set depends on that value."""
        return None

    @abstractmethod
    def values(self, cube: Array, leaf: Leaf) -> Array:
        """Return the set's values at points of the unit cube, [rows, ...]: one value for each point.

        - `cube`: points [rows, coordinates], in [0, 1).
        - `leaf`: the scenario's own value at the path of the set.

        Raises DefinitionError if the set does not fit this value, or is empty.
        """

    def _spread(self, cube: Array, leaf: Leaf) -> Array:
        """Reshape the coordinates to the shape of the leaf's draws."""
        if self.each:
            return cube.reshape(len(cube), *leaf.shape_of_each)
        return cube.reshape(len(cube), *[1] * len(leaf.shape))


class Between(AbstractSet):
    """All values between two ends."""

    between: Annotated[list[Numbers], Field(min_length=2, max_length=2)]
    """Lower and upper end, each a number or one number per joint."""
    distribution: Distribution = "uniform"
    """Distribution of the values."""
    mean: float | None = input_field("mean of the `normal` distribution", default=None, source="the middle")
    deviation: float | None = input_field(
        "standard deviation of the `normal` distribution", "", "> 0", default=None, source="a sixth of the width"
    )

    @property
    def example(self) -> Any:
        return self.between[0]

    def values(self, cube: Array, leaf: Leaf) -> Array:
        lower, upper = (leaf.fitting(end, "between") for end in self.between)
        _require_order(lower, upper)
        if self.distribution != "normal" and (self.mean, self.deviation) != (None, None):
            raise DefinitionError(
                f"`mean` and `deviation` are only for `normal`; leave them out for `{self.distribution}`"
            )
        return shares(self._spread(cube, leaf), lower, upper, self.distribution, Cut(self.mean, self.deviation))


class Around(AbstractSet):
    """All values within a distance from the scenario's own value."""

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
            raise PydanticCustomError(
                "unknown_key", "must be >= 0 and finite; got {given}", {"given": short_repr(value)}
            )
        return value

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("around")
        reach = np.abs(own) * _share(self.around) if isinstance(self.around, str) else self.around
        # With `each`, a single number for all joints becomes a number per joint.
        lower, upper = (leaf.spread_out(np.asarray(own + sign * reach), bool(self.each)) for sign in (-1.0, 1.0))
        return shares(self._spread(cube, leaf), lower, upper, self.distribution, Cut())


class Ball(AbstractSet):
    """All vectors within a distance from the scenario's own value, such as a centre of mass."""

    ball: float = input_field("radius of the ball, in the parameter's unit", "", ">= 0")
    distribution: Literal["uniform", "surface"] = "uniform"
    """`uniform` in the ball, or on its `surface`."""

    def coordinates(self, leaf: Leaf) -> int:
        """A coordinate for each number, and one for the distance."""
        return leaf.size + 1

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("ball").reshape(-1)
        direction = truncated_normal(cube[:, :-1])
        # The cube's centre has no direction; it maps to the ball's centre.
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
        far = np.ones(len(cube)) if self.distribution == "surface" else cube[:, -1] ** (1.0 / leaf.size)
        return (own + self.ball * far[:, None] * direction).reshape(len(cube), *leaf.shape)


class Discrete(AbstractSet):
    """A finite set of values."""

    choice: Annotated[list[float | list[float] | list[list[float]]], Field(min_length=1)] | Literal["any"]
    """The values; for a seed, `any` for all integers from 0 to 2³² - 1."""
    weights: list[float] | None = None
    """Probabilities of the values; by default equal."""

    @property
    def example(self) -> Any:
        return 0 if self.choice == "any" else self.choice[0]

    def values(self, cube: Array, leaf: Leaf) -> Array:
        u = self._spread(cube, leaf)
        if self.choice == "any":
            if not leaf.integer:
                raise DefinitionError("`choice: any` is only for seeds; write the values, or use `between`")
            return np.floor(u * MOST_SEEDS).astype(int).reshape(len(cube), *leaf.shape)
        weights = self._weights(len(self.choice))
        edges = np.cumsum(weights)[:-1] / np.sum(weights)
        which = np.searchsorted(edges, u, side="right")
        fitting = [leaf.fitting(value, "choice") for value in self.choice]
        shape = np.broadcast_shapes(*(value.shape for value in fitting), leaf.shape_of_each if self.each else ())
        values = np.stack([np.broadcast_to(value, shape) for value in fitting])
        if leaf.integer and (values != np.round(values)).any():
            raise DefinitionError(f"needs whole numbers; got {short_repr(self.choice)}")
        picked: Array = np.take_along_axis(values[None], which.reshape(len(cube), 1, *u.shape[1:]), axis=1)[:, 0]
        return picked.astype(int) if leaf.integer else picked

    def _weights(self, count: int) -> Array:
        weights = np.ones(count) if self.weights is None else np.asarray(self.weights, float)
        if len(weights) != count or not (np.isfinite(weights) & (weights >= 0)).all() or not weights.sum() > 0:
            raise DefinitionError(f"`weights` must be {count} numbers >= 0, not all 0; got {short_repr(self.weights)}")
        return weights


class StandardError(AbstractSet):
    """Estimates with standard errors, as from `slidax identify`: a truncated normal distribution."""

    standard_error: float | list[float] | list[list[float]]
    """Standard error of each number."""
    unit: str = ""
    """Unit of the number, for readers of the file."""
    identifiable: bool = True
    """True if the log determined the parameter, for readers of the file."""
    sigmas: float = input_field("truncation of the normal distribution, in standard errors", "", "(0, 8]", default=3.0)

    def coordinates(self, leaf: Leaf) -> int:
        """A coordinate for each number; their errors are independent."""
        return int(np.prod(leaf.shape, dtype=int))

    def values(self, cube: Array, leaf: Leaf) -> Array:
        own = leaf.own_value("standard_error")
        error = np.broadcast_to(leaf.fitting(self.standard_error, "standard_error"), own.shape)
        if not (np.isfinite(error) & (error >= 0)).all():
            raise DefinitionError(f"`standard_error` must be >= 0 and finite; got {short_repr(self.standard_error)}")
        reach = truncated_normal(cube.reshape(len(cube), *own.shape), self.sigmas)
        return np.clip(own + error * reach, *leaf.ends)


class InsideEnvelope(AbstractSet):
    """Start positions inside the envelope at t = 0; the velocities are those of the scenario."""

    inside: Literal["envelope"]
    """`envelope`: the tolerance band if there is one, otherwise the scheme's envelope."""
    share: float = input_field("share of the envelope's half width to use", "", "(0, 1)", default=0.9)
    each: Literal["joint", "entry"] | None = Field(default="joint", description="A separate draw for each joint.")

    def values(self, cube: Array, leaf: Leaf) -> Array:
        if leaf.envelope is None:
            raise DefinitionError("`inside` is only for the path `start`")
        lower, upper = leaf.envelope()
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        return middle + self.share * half * (2.0 * self._spread(cube, leaf) - 1.0)


class InertialBand(AbstractSet):
    """All arms in a band of inertial parameters around the nominal arm; its only path is `robot.plant.inertial`.

    J0, φ0 and M0 are of the nominal arm: a body's pseudo-inertia (with a permanent payload), all inertial parameters,
    and the mass matrix.

    - Without `deviations`: `(1 - p) J0 <= J <= (1 + p) J0` for each body, and rotor inertias within a share p.
    - With `deviations`, as `slidax identify` writes them: all `φ0 + ξ D` with `|ξ| <= 1` whose mass matrix is between
      `(1 - p) M0(q)` and `(1 + p) M0(q)` for every q.
    """

    band: float = input_field("p, the relative half width of the band", "", "[0, 1)")
    confidence: float | None = input_field(
        "confidence that the set contains the true arm, for an identified arm", "", "(0, 1)", default=None
    )
    deviations: list[list[float]] | None = None
    """D, the ellipsoid of an identified arm; a row has ten numbers for each body, then one for each rotor."""

    def coordinates(self, leaf: Leaf) -> int:
        """Number of coordinates: 11 for each joint; for an identified arm, one for each row of D, and one for |ξ|."""
        return INERTIAL * leaf.joints if self.deviations is None else len(self.deviations) + 1

    def values(self, cube: Array, leaf: Leaf) -> Array:
        # Imported here, since few files need it and it imports SciPy.
        from .inertial_band import changes_in_ellipsoid, changes_of_bodies

        arm = None if leaf.arm is None else leaf.arm()
        if leaf.path != INERTIAL_PATH or not isinstance(arm, Articulated):
            raise DefinitionError(f"`band` is only for `{INERTIAL_PATH}` of an arm with rigid links")
        if self.deviations is None:
            return changes_of_bodies(2.0 * cube - 1.0, arm, self.band)
        xi = truncated_normal(cube[:, :-1])
        xi *= cube[:, -1:] ** (1.0 / xi.shape[1]) / np.maximum(np.linalg.norm(xi, axis=1, keepdims=True), 1e-12)
        return changes_in_ellipsoid(xi, np.asarray(self.deviations, float), arm, self.band)


INERTIAL_PATH = "robot.plant.inertial"
"""Only path that an `InertialBand` may have."""


KINDS: dict[str, type[AbstractSet]] = {
    "between": Between,
    "around": Around,
    "ball": Ball,
    "choice": Discrete,
    "standard_error": StandardError,
    "inside": InsideEnvelope,
    "band": InertialBand,
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
        share = parse_number(number) / 100.0
    except ValueError:
        share = np.nan
    if not sign or rest.strip() or not (np.isfinite(share) and share >= 0):
        message = "must be a number, or a share >= 0 such as `20 %`; got `{given}`"
        raise PydanticCustomError("unknown_key", message, {"given": plain_name(text)})
    return share


def _require_order(lower: Array, upper: Array) -> None:
    if not (lower <= upper).all():
        raise DefinitionError(f"is empty: its lower end {short_repr(lower)} is above its upper end {short_repr(upper)}")


FILE = "file"
"""Key whose value is the name of a file with a mapping `uncertainty`, as `slidax identify` writes it."""


def _with_file(data: Any, info: Any) -> Any:
    if not isinstance(data, dict) or FILE not in data:
        return data
    path = Path((info.context or {}).get("folder", "")) / str(data[FILE])
    try:
        content = read_yaml_file(path)
    except DefinitionError as error:
        raise _refused(str(error)) from None
    sets = content.get("uncertainty") if isinstance(content, dict) else None
    if not isinstance(sets, dict):
        raise _refused(f"the file `{path}` has no mapping `uncertainty`, as `slidax identify` writes one")
    return sets | {path: values for path, values in data.items() if path != FILE}


def _refused(message: str) -> PydanticCustomError:
    return PydanticCustomError("unknown_key", "{message}", {"message": message})


if TYPE_CHECKING:
    Uncertainty = dict[str, AbstractSet]
else:
    Uncertainty = Annotated[dict[str, AnySet], BeforeValidator(_with_file)]
"""Sets by dotted path of the scenario; the key `file` names a file with more sets."""
