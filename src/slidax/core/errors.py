"""Errors for invalid definitions and runs that end early, and the checks that raise them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from reprlib import Repr
from typing import Any, Self

import jax
import numpy as np
from jaxtyping import Array

LONGEST = 80
"""Most characters of a value or a name in a message."""

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)

# Python 3.11 takes no keywords here.
_SHORT = Repr()
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxstring = _SHORT.maxother = LONGEST
_SHORT.maxdict = _SHORT.maxset = 8
_SHORT.maxlong = 40


@dataclass(frozen=True)
class Setting:
    """A setting that makes slidax accept an input which is otherwise an error, written for each interface.

    - `name`, `value`: name and value of the setting, such as `inertias` and `nearest`.
    """

    name: str
    value: str

    in_python = property(lambda self: f'{self.name}="{self.value}"', doc='As an argument: `inertias="nearest"`.')
    in_yaml = property(lambda self: f"{self.name}: {self.value}", doc="As a line of a scenario: `inertias: nearest`.")
    as_option = property(lambda self: f"--{self.name} {self.value}", doc="As an option: `--inertias nearest`.")


class DefinitionError(ValueError):
    """An invalid definition. The message names the field, the rule, the value, the joint and the remedy.

    - `message`: the message without the path.
    - `where`: path of the field in a scenario, such as `scheme.performance`; empty if the field is not in a scenario.
    """

    setting: Setting | None = None
    """The setting that the message names as a remedy, or None; `reworded` writes it for another interface."""

    def __init__(self, message: str, *, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.message = message
        self.where = where

    def offering(self, setting: Setting | None) -> Self:
        """Attach the setting that the message names as a remedy (None for none); return this error."""
        self.setting = setting
        return self

    def reworded(self, words: str) -> DefinitionError:
        """Return a copy of the error whose message writes the remedy's setting in other words.

        - `words`: the new text for the setting, such as `error.setting.as_option`.
        """
        message, setting = self.message, self.setting
        if setting is not None:
            # In one pass, since the new words may themselves have one of these forms.
            forms = map(re.escape, (setting.in_python, setting.in_yaml, setting.as_option))
            message = re.sub("|".join(forms), lambda _: words, message)
        return DefinitionError(message, where=self.where).offering(setting)


class DefinitionWarning(UserWarning):
    """A definition is incomplete or contradicts itself; the message says how slidax interprets it."""


class OutcomeError(RuntimeError):
    """A run ended before its end time; raised by `simulate(..., throw=True)`.

    - `outcome`: what happened, to which joint and when.
    - `run`: the run up to that time, with its log and metrics.
    """

    def __init__(self, outcome: Any, run: Any = None) -> None:
        super().__init__(outcome.message)
        self.outcome = outcome
        self.run = run


@contextmanager
def locate_errors(where: str) -> Iterator[None]:
    """Add the path `where` to the message of a DefinitionError in the `with` block; nested paths are joined."""
    try:
        yield
    except DefinitionError as error:
        path = f"{where}.{error.where}" if error.where else where
        raise DefinitionError(error.message, where=path).offering(error.setting) from error


def nearest_word(word: str, known: Iterable[str]) -> str:
    """Remedy for an unknown name, as text: "did you mean `...`?" with the most similar name, or all known names.

    - `word`: the unknown name, in upper or lower case.
    - `known`: all names that exist.
    """
    names, word = list(known), word[:LONGEST]
    by_small_letters = {name.lower(): name for name in names}
    close = get_close_matches(word.lower(), by_small_letters, n=1, cutoff=0.6)
    if close:
        return f"did you mean `{by_small_letters[close[0]]}`?"
    return "there are: " + ", ".join(f"`{name}`" for name in names)


def short_repr(value: Any) -> str:
    """Python representation of a value on one line, cut off after `LONGEST` characters, for a message.

    - `value`: any object, also a list with millions of entries.
    """
    if isinstance(value, np.ndarray):
        value = (value if value.size <= LONGEST else value.ravel()[:LONGEST]).tolist()
    text = _SHORT.repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def plain_name(word: object) -> str:
    """A name in the form of `short_repr`, but without quotation marks, for a message that puts it in backquotes.

    - `word`: the name; an object that is no string is shown as by `short_repr`.
    """
    return short_repr(word)[1:-1] if isinstance(word, str) else short_repr(word)


def count_noun(number: int, noun: str, plural: str = "") -> str:
    """A number with its noun, "1 run" or "2 runs".

    - `noun`: singular.
    - `plural`: by default the noun with an s.
    """
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def percent(share: float) -> str:
    """A share as a percentage, rounded to two digits or to a whole number: "4.2 %", "61 %", "6338 %".

    Near 100 % the text has enough digits to show if the share is below or above 100 %: "99.97 %".

    - `share`: 1 is 100 %.
    """
    value = 100.0 * share
    size, gap = abs(value), abs(abs(value) - 100.0)
    if not math.isfinite(value) or not size:
        return f"{value:.0f} %"
    decimals = 1 - math.floor(math.log10(gap if 1e-4 < gap < 1.0 else size))
    text = f"{value:.{min(max(decimals, 0), 9)}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def span(low: float, high: float) -> str:
    """An interval with two digits, "0.13 to 0.27"; "0.13" if both ends round to the same text.

    - `low`, `high`: ends of the interval.
    """
    ends = f"{low:.2g}", f"{high:.2g}"
    return " to ".join(dict.fromkeys(ends))


def each_of(number: int, noun: str) -> str:
    """The text "each of the 3 joints", or "the joint" if there is a single one.

    - `noun`: singular.
    """
    return f"the {noun}" if number == 1 else f"each of the {number} {noun}s"


def is_traced(tree: Any) -> bool:
    """True if JAX traces a leaf (in `jit`, `vmap` or `grad`), so that its value is unknown and cannot be checked.

    - `tree`: any pytree of arrays.
    """
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def as_array(value: Any) -> Array:
    """Convert a number or a list of numbers to a JAX array of floats; return a JAX array unchanged.

    It is the converter of fields that `parameter` declares, whose values are then differentiable leaves.

    - `value`: a number, a list of numbers or an array.

    Raises DefinitionError for any other value.
    """
    if isinstance(value, jax.Array):
        return value
    try:
        # Unlike `jnp.asarray`, this compiles nothing.
        return jax.device_put(np.asarray(value, dtype=float))
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"a number or a list of numbers is needed; got {short_repr(value)}") from error


def parse_number(text: str) -> float:
    """Return the finite number in a text, such as `2`, `-0.5` or ` 1e-3 `.

    - `text`: a decimal number. Unlike `float`, it must not have the form `1_5`, `nan` or `inf`, or non-ASCII digits.

    Raises ValueError for any other text.
    """
    number = float(text) if _NUMBER.fullmatch(text.strip()) else math.nan
    if not math.isfinite(number):
        raise ValueError(f"`{plain_name(text)}` is not a finite number")
    return number


def float_array(name: str, value: Any) -> np.ndarray:
    """Return numbers, or rows of numbers, as a NumPy array of floats.

    - `name`: the field or argument, for the message.
    - `value`: a number, a list of numbers, or a list of rows of equal length.

    Raises DefinitionError for any other value.
    """
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(
            f"`{name}` must be numbers, or rows of as many numbers each; got {short_repr(value)}"
        ) from None


def static_value(value: Any) -> Any:
    """Convert an array to NumPy, for checks of its values; return a traced array unchanged.

    A check of a JAX array would be compiled, which takes a hundred times as long.

    - `value`: a number or an array.
    """
    return value if is_traced(value) else np.asarray(value)


def require(owner: object, field: str, holds: Any, rule: str, *, finite: bool = True, each: str = "joint") -> None:
    """Raise a DefinitionError unless `holds` is true for every entry of a field, and the field is finite.

    Traced values pass, since they are unknown.

    - `owner`: object with the field; the message names its class.
    - `field`: name of the field.
    - `holds`: one bool, or one for each entry of the field; for a field of one number also one for each joint.
    - `rule`: the rule with its equation, for the message: "must be > 2 (eq. 20)".
    - `finite`: False to accept infinite values; NaN is never accepted.
    - `each`: noun in the message for one entry of a vector, "joint" or "entry".
    """
    value = getattr(owner, field)
    if is_traced((value, holds)):
        return
    number = np.asarray(value)
    wrong = ~(np.asarray(holds) & (np.isfinite(number) if finite else ~np.isnan(number)))
    if not wrong.any():
        return
    name = f"`{type(owner).__name__}.{field}`"
    if number.ndim == 0 and wrong.ndim == 0:
        raise DefinitionError(f"{name} {rule}; got {number.item():g}")
    if number.ndim == wrong.ndim == 1:
        first = int(np.argmax(wrong))
        label = _joint(owner, first) if each == "joint" else f"{each} {first + 1}"
        raise DefinitionError(f"{name} {rule}; got {number[first].item():g} for {label}")
    if number.ndim == 0:
        joint = int(np.argmax(wrong))
        raise DefinitionError(f"{name} {rule}; got {number.item():g}, which fails for {_joint(owner, joint)}")
    if np.ndim(holds) == number.ndim:
        entry = tuple(int(index[0]) for index in np.nonzero(wrong))
        raise DefinitionError(f"{name} {rule}; got {number[entry].item():g} in entry {[i + 1 for i in entry]}")
    raise DefinitionError(f"{name} {rule}; got {short_repr(number)}")


def _joint(owner: object, number: int) -> str:
    """Name of a joint, or its number if the owner's joints have no names."""
    names = getattr(owner, "joint_names", ())
    name = names[number] if number < len(names) else f"joint {number + 1}"
    return name if name == f"joint {number + 1}" else f"joint `{name}`"


def require_shape(owner: object, shape: tuple[int, ...], *fields: str) -> None:
    """Raise a DefinitionError unless each named field of `owner` has exactly this shape.

    - `shape`: required shape; () for one number.
    - `fields`: names of the fields.
    """
    for field in fields:
        got = np.shape(getattr(owner, field))
        if got != shape:
            expected = f"{' x '.join(map(str, shape))} numbers" if shape else "one number"
            raise DefinitionError(f"`{type(owner).__name__}.{field}` must be {expected}; got shape {list(got)}")


def require_consistent(owner: object, *fields: str) -> None:
    """Raise a DefinitionError unless each field is one number or a vector, and all vectors have the same length.

    - `owner`: object with the fields.
    - `fields`: names of the fields.
    """
    first = ""
    for field in fields:
        shape = np.shape(getattr(owner, field))
        name = f"`{type(owner).__name__}.{field}`"
        if len(shape) > 1:
            raise DefinitionError(f"{name} must be one number or one per joint; got shape {list(shape)}")
        if shape and first and shape != np.shape(getattr(owner, first)):
            other = len(getattr(owner, first))
            raise DefinitionError(
                f"{name} has {count_noun(shape[0], 'entry', 'entries')}, but `{first}` has {other}; give one number or "
                "one per joint"
            )
        first = field if shape and not first else first


def require_joints(tree: object, joints: int, of: str) -> None:
    """Raise a DefinitionError unless each parameter in `tree` is one number, one per joint, or a matrix [n n].

    - `tree`: any pytree of arrays. `joints`: n. `of`: words for the arm that has these joints, for the message.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        if np.shape(leaf) not in ((), (joints,), (joints, joints)):
            raise _not_per_joint(type(tree).__name__ + jax.tree_util.keystr(path), leaf, joints, of)


def require_per_joint(owner: object, joints: int, of: str, *fields: str) -> None:
    """Raise a DefinitionError unless each named field is one number, or has one entry per joint.

    - `owner`: object with the fields. `joints`: number of joints.
    - `of`: words for the arm that has these joints, for the message.
    - `fields`: names of the fields.
    """
    for field in fields:
        if np.shape(getattr(owner, field)) not in ((), (joints,)):
            raise _not_per_joint(f"{type(owner).__name__}.{field}", getattr(owner, field), joints, of)


def _not_per_joint(name: str, value: Any, joints: int, of: str) -> DefinitionError:
    shape, count = list(np.shape(value)), count_noun(joints, "joint")
    return DefinitionError(f"`{name}` has shape {shape}, but {of} has {count}; give one number or {joints} of them")
