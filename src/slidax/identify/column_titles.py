"""Column titles of a table, their words and units, and the joints they belong to."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import pi

from slidax.core.errors import DefinitionError, nearest_word, plain_name, short_repr

from .logs import LogColumns, ReadOptions

TIMES = ("t", "time", "timestamp", "__time", "%time", "seconds", "stamp", "elapsed", "duration", "rosbagtimestamp")
"""Titles of the time column, the likeliest first."""

WORDS = {
    "q": ("q", "position", "pos", "actual_q", "joint_position", "q_measured", "measured_position", "angle", "theta"),
    "dq": ("dq", "velocity", "vel", "qd", "actual_qd", "joint_velocity", "qdot", "speed"),
    "tau": ("tau", "torque", "effort", "tau_j", "joint_torque", "tau_measured", "measured_torque", "joint_effort"),
}
"""Words for a quantity in a title, before or after the joint, likeliest first; with those of libfranka and RTDE."""

PLURALS = {"positions": "position", "velocities": "velocity", "torques": "torque", "efforts": "effort"}
"""Plural forms that a title may use."""

CURRENTS = ("current", "actual_current", "motor_current", "joint_current")
COMPUTED = ("target_moment", "tau_j_d", "target_torque", "desired_torque", "commanded_torque")
"""Words for columns that are not measured torques: currents, and torques that a controller has computed."""

UNITS: dict[str, dict[str, float]] = {
    "t": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9},
    "q": {"rad": 1.0, "deg": pi / 180, "degrees": pi / 180, "°": pi / 180, "m": 1.0, "mm": 1e-3},
    "dq": {"rad/s": 1.0, "rads1": 1.0, "deg/s": pi / 180, "°/s": pi / 180, "m/s": 1.0, "mm/s": 1e-3, "rpm": pi / 30},
    "tau": {"nm": 1.0, "n": 1.0, "mnm": 1e-3, "nmm": 1e-3, "knm": 1e3, "kn": 1e3, "ncm": 1e-2},
}
"""Units that a title may name, and the factor from each to s, rad, rad/s or N m (or m, m/s, N)."""

STATES = ("", "state", "robot_state", "joint_states", "joint_state", "measured", "actual", "feedback", "robot0")
"""Prefixes of measured columns, as in `state.q[0]` next to `cmd.q[0]`."""

COMMANDS = ("cmd", "command", "desired", "target", "goal", "reference", "ref", "setpoint", "output", "error")
"""Prefixes of columns that were not measured."""

RATES = ("success_rate", "state.success_rate", "control_command_success_rate")
"""Titles that only libfranka writes; its times are in milliseconds."""

INDEX = re.compile(r"(?P<stem>.*?)[._]?(?:\[(?P<a>\d{1,6})\]|\((?P<b>\d{1,6})\)|(?P<c>\d{1,6}))")
"""A title that ends in a joint's number, as in `q_1`, `q[0]` and `position(3)`."""

JOINT = re.compile(r"(?:joint|axis|motor|j)[_.]?(?P<index>\d{1,6})")
"""A joint's number with a word, as in `joint_3` and `axis2`."""

_UNIT = re.compile(r"\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\))$")
_ENDING = re.compile(r"(?<=[a-z0-9\])])_(?P<unit>ms|us|ns|s|sec|rad|deg|nm)$")
"""A unit at the end of a title, as in `time_ms` and `q_1_deg`."""


@dataclass(frozen=True)
class Title:
    """A column title.

    - `text`: the title as written.
    - `bare`: the title without its unit, its parts separated by dots.
    - `unit`: the unit as written; empty if there is none.
    """

    text: str
    bare: str
    unit: str

    @classmethod
    def of(cls, text: str) -> Title:
        """Return the parts of a title."""
        bare, unit = text.strip().strip("\"'").strip(), ""
        matched = _UNIT.search(bare)
        if matched is not None:
            inside = matched["a"] if matched["a"] is not None else matched["b"]
            if not inside.strip().isdigit():
                bare, unit = bare[: matched.start()], inside
        bare = re.sub(r"[/:]+", ".", re.sub(r"\s+", "_", bare.strip())).strip(".")
        ending = _ENDING.search(bare.lower())
        if (
            ending is not None
            and not unit
            and (ending["unit"] not in UNITS["t"] or ending.string[: ending.start()] in TIMES)
        ):
            bare, unit = bare[: ending.start()], ending["unit"]
        return cls(text, bare, unit.strip())

    def suffixes(self) -> Iterator[tuple[str, str]]:
        """Yield each split of the title into prefix and suffix, the longest suffix first."""
        parts = self.bare.split(".")[-6:]
        for start in range(len(parts)):
            yield ".".join(parts[:start]), ".".join(parts[start:])


def rank_of_state(prefix: str) -> int:
    """Return the rank of a column by its title's prefix: small for measured states, largest for commands.

    If several columns fit a quantity, the column with the smallest rank is read.

    - `prefix`: prefix of a title, such as `robot.state` in `robot.state.q`; its parts are separated by dots.
    """
    last = prefix.rpartition(".")[2]
    return STATES.index(last) if last in STATES else len(STATES) + is_command(prefix)


def is_command(prefix: str) -> bool:
    """True if a column with this prefix is a command, which was not measured.

    - `prefix`: prefix of a title, its parts separated by dots.
    """
    return prefix.rpartition(".")[2] in COMMANDS


def scale_of(quantity: str, title: Title, source: str) -> tuple[float, str]:
    """Return the factor from a column's unit to rad, rad/s or N m (or m, m/s, N), and a note on the conversion.

    - `quantity`: `q`, `dq` or `tau`.
    - `source`: name of the table, for messages.

    Raises DefinitionError if the unit is unknown.
    """
    unit = _plain_unit(title)
    if unit in NO_UNIT:
        return 1.0, ""
    # These are the only units where upper and lower case differ in meaning.
    scale = 1e6 if quantity == "tau" and unit in ("MNm", "MN") else UNITS[quantity].get(unit.lower())
    if scale is None:
        options = ", ".join(list(UNITS[quantity])[:4])
        raise DefinitionError(
            f"{source}: column `{plain_name(title.text)}` is in `{plain_name(title.unit)}`, an unknown unit of "
            f"`{quantity}` ({options}, ...): convert the column, or correct the unit in its title"
        )
    return (
        scale,
        "" if scale == 1.0 else f"`{quantity}` is converted from {plain_name(title.unit)}, the unit in the title",
    )


def base_unit_of(quantity: str, title: Title) -> str:
    """Return `rad` or `m`, the base of the unit in a title of `q` or `dq`; empty if the title names none.

    - `quantity`: `q`, `dq` or `tau`.
    """
    unit = _plain_unit(title)
    if quantity == "tau" or unit in NO_UNIT:
        return ""
    return "m" if unit.lower().partition("/")[0] in ("m", "mm") else "rad"


def _plain_unit(title: Title) -> str:
    return re.sub(r"[\s·*⋅.^-]", "", title.unit)


NO_UNIT = ("", "1", "SI")
"""Units in a title that stand for rad, rad/s and N m, or for m, m/s and N, by the kind of joint."""


def scale_of_time(title: Title, titles: Sequence[Title], source: str) -> tuple[float, str]:
    """Return the factor from the time column's unit to s, and a note on the conversion.

    - `titles`: titles of all columns, which may show the tool that wrote them.
    - `source`: name of the table, for messages.

    Raises DefinitionError if the unit is unknown.
    """
    unit = title.unit.lower().strip()
    if not unit and title.bare.lower() in ("%time", "rosbagtimestamp"):
        return 1e-9, f"the times in `{plain_name(title.text)}` are nanoseconds, as ROS writes them"
    if not unit and any(other.bare.lower() in RATES for other in titles):
        return 1e-3, f"the times in `{plain_name(title.text)}` are milliseconds, as libfranka writes them"
    scale = UNITS["t"].get(unit) if unit else 1.0
    if scale is None:
        raise DefinitionError(
            f"{source}: column `{plain_name(title.text)}` is in `{plain_name(title.unit)}`, which is no unit of time "
            "(s, ms, us, ns): convert the column, or correct the unit in its title"
        )
    return (
        scale,
        "" if scale == 1.0 else f"the times are converted from {plain_name(title.unit)}, the unit in the title",
    )


MOST_COLUMNS = 10_000
"""Largest number of columns in a table."""


def match_columns(titles: Sequence[str], joints: Sequence[str], source: str, reading: ReadOptions) -> LogColumns:
    """Match columns to joints and quantities by titles such as `q1`, `q_1`, `NAME.position`, `tau_1`, `state.q[0]`.

    Joint names take precedence over numbers, which start at 0 or 1, in the arm's order.

    - `titles`: titles of the columns, with an optional unit in brackets at the end.
    - `joints`: the arm's joints, in its order.
    - `source`: name of the table, for messages.
    - `reading`: the user's choices where titles are ambiguous.

    Raises DefinitionError if times, a position or a torque is missing, or if titles are ambiguous.
    """
    return _Matching(titles, joints, source, reading).columns()


@dataclass
class _Group:
    """Columns of a quantity with the same word and prefix, by joint name and by joint number.

    `duplicates` are pairs of columns for the same joint, such as `q_1` and `q1`.
    """

    named: dict[str, Title] = field(default_factory=dict)
    numbered: dict[int, Title] = field(default_factory=dict)
    duplicates: list[tuple[Title, Title]] = field(default_factory=list)


class _Matching:
    """Match of a table's titles with the joints of an arm."""

    def __init__(self, titles: Sequence[str], joints: Sequence[str], source: str, reading: ReadOptions) -> None:
        if len(titles) > MOST_COLUMNS:
            raise DefinitionError(
                f"{source} has {len(titles)} columns, but at most {MOST_COLUMNS} are read: leave some of them out"
            )
        self.source, self.joints, self.reading = source, joints, reading
        lower = len({name.lower() for name in joints}) == len(joints)
        self.fold = str.lower if lower else str
        self.keys = {self.fold(re.sub(r"[/: ]", ".", name)): name for name in joints}
        self.all = [Title.of(text) for text in titles]
        self.notes: list[str] = []
        self.doubled = {text for text, count in Counter(titles).items() if count > 1}
        self.dropped_numbers = {int(word) for word in reading.drop if re.fullmatch(r"\d{1,6}", word)}
        self.dropped_names = [word for word in reading.drop if word not in WORDS and not word.isdigit()]
        left = [title for title in self.all if title.text.strip() not in reading.drop]
        self.left = [title for title in left if title.bare not in reading.drop]
        self._require_dropped_exist()

    def columns(self) -> LogColumns:
        time = self._time()
        of: dict[str, list[Title]] = {}
        for quantity in WORDS:
            if quantity in self.reading.drop:
                self.notes.append(f"`{quantity}` is left out, as `drop` says")
                continue
            columns = self._quantity(quantity)
            if columns is not None:
                of[quantity] = columns
        scales = {time.text: scale_of_time(time, self.all, self.source)}
        for quantity, columns in of.items():
            scales |= {title.text: scale_of(quantity, title, self.source) for title in columns}
        self.notes += [note for _, note in scales.values() if note]
        scale = {text: value for text, (value, _) in scales.items()}
        used = [time, *(title for columns in of.values() for title in columns)]
        for title in used:
            if title.text in self.doubled:
                raise DefinitionError(
                    f"{self.source} has two columns `{plain_name(title.text)}`: leave one of them out or rename it"
                )
        texts = {quantity: [title.text for title in columns] for quantity, columns in of.items()}
        bases = {title.text: base_unit_of(quantity, title) for quantity, columns in of.items() for title in columns}
        bases = {text: base for text, base in bases.items() if base}
        return LogColumns(time.text, texts, scale, tuple(dict.fromkeys(self.notes)), bases)

    def _require_dropped_exist(self) -> None:
        for word in self.dropped_names:
            if word in self.joints:
                raise DefinitionError(
                    f"`drop` names `{plain_name(word)}`, a joint of the arm: identification needs all joints; "
                    "lock it in the robot file if it does not move"
                )
            key = self.fold(word)
            known = any(
                key in re.split(r"[._]", self.fold(title.bare)) or key in self.fold(title.bare) for title in self.all
            )
            if not known:
                raise DefinitionError(
                    f"`drop` names `{plain_name(word)}`, which is no column or joint of {self.source}; the columns "
                    f"are {self._some()}"
                )

    def _some(self) -> str:
        texts = ", ".join(f"`{plain_name(title.text)}`" for title in self.all[:8])
        return f"{texts}, ..." if len(self.all) > 8 else texts

    def _time(self) -> Title:
        choice = self.reading.columns.get("t")
        if choice is not None:
            return self._named_column(choice if isinstance(choice, str) else choice[0], "t")
        for word in TIMES:
            for title in self.left:
                if title.bare.lower() == word:
                    return title
        for word in TIMES:
            ending = [title for title in self.left if title.bare.lower().rpartition(".")[2] == word]
            if len(ending) == 1:
                return ending[0]
        raise DefinitionError(
            f"{self.source} has no time column: rename yours to `time` [s], or give its name (`--columns t=NAME`); "
            f"the columns are {self._some()}"
        )

    def _named_column(self, text: str, quantity: str) -> Title:
        for title in self.all:
            if text in (title.text.strip(), title.bare):
                return title
        names = [title.text.strip() for title in self.all]
        raise DefinitionError(
            f"{self.source} has no column `{plain_name(text)}` for `{quantity}`; {nearest_word(text, names[:200])}"
        )

    def _quantity(self, quantity: str) -> list[Title] | None:
        choice = self.reading.columns.get(quantity)
        if isinstance(choice, str) and len(self.joints) == 1 and any(t.text.strip() == choice for t in self.all):
            choice = [choice]
        if choice is not None and not isinstance(choice, str):
            if len(choice) != len(self.joints):
                raise DefinitionError(
                    f"`columns` names {len(choice)} columns for `{quantity}`, but the arm has {len(self.joints)} "
                    "joints: name a column for each joint"
                )
            return [self._named_column(text, quantity) for text in choice]
        words = WORDS[quantity] if choice is None else (Title.of(choice).bare.lower(),)
        groups = self._groups(words, positions=quantity == "q" and choice is None)
        complete = [key for key, group in groups.items() if self._is_complete(group)]
        if not complete:
            self._require_missing_is_allowed(quantity, words, groups, choice)
            return None
        first = min(complete, key=lambda key: (is_command(key[1]), key[0], rank_of_state(key[1])))

        def name_of(key: tuple[int, str]) -> str:
            return f"{key[1]}.{(*words, '')[key[0]]}".strip(".")

        if choice is None and is_command(first[1]):
            name = name_of(first)
            if quantity == "dq":
                self.notes.append(f"`{plain_name(name)}` is a command, not a measurement: it is left out")
                return None
            raise DefinitionError(
                f"{self.source} has no measured `{quantity}`, only `{plain_name(name)}`; `--columns {quantity}={name}` "
                "reads it anyway"
            )
        rivals = [key for key in complete if key[0] == first[0] and rank_of_state(key[1]) == rank_of_state(first[1])]
        if len(rivals) > 1:
            names = ", ".join(f"`{plain_name(name_of(key))}`" for key in rivals)
            raise DefinitionError(
                f"{self.source} has several columns for `{quantity}`: {names}; choose one, "
                f"such as `--columns {quantity}={name_of(rivals[0])}`"
            )
        return self._joint_columns(quantity, groups[first])

    def _groups(self, words: Sequence[str], *, positions: bool) -> dict[tuple[int, str], _Group]:
        """Return the columns of a quantity; each group's key is the index of its word in `words`, and its prefix.

        - `positions`: True if a joint name without a word is a position; its index is then the number of words.
        """
        rank = {word: index for index, word in reversed(list(enumerate(words)))}
        for plural, singular in PLURALS.items():
            for text, index in list(rank.items()):
                if text == singular or text.endswith(f".{singular}"):
                    rank.setdefault(text.removesuffix(singular) + plural, index)
        groups: dict[tuple[int, str], _Group] = {}
        for title in self.left:
            for prefix, suffix in title.suffixes():
                matched = self._match(suffix, rank, len(words) if positions else None)
                if matched is not None:
                    word, key = matched
                    group = groups.setdefault((word, prefix.lower()), _Group())
                    first = (
                        group.numbered.setdefault(key, title)
                        if isinstance(key, int)
                        else group.named.setdefault(key, title)
                    )
                    if first.text != title.text and first.unit == title.unit:
                        group.duplicates.append((first, title))
                    break
        return groups

    def _match(self, suffix: str, rank: Mapping[str, int], bare: int | None) -> tuple[int, str | int] | None:
        """Return the index of the word in a title's suffix, and the joint's name or number; None without a match.

        - `rank`: index of each word.
        - `bare`: index for a joint name without a word; None if such a title does not match.
        """
        text = self.fold(suffix)
        lower = suffix.lower()
        if bare is not None and text in self.keys:
            return bare, self.keys[text]
        for key, name in self.keys.items():
            if len(text) > len(key) + 1 and (text.startswith(key) or text.endswith(key)):
                rest = lower[len(key) :] if text.startswith(key) else lower[: -len(key)]
                word = rest.strip("._")
                if word in rank and len(word) < len(rest):
                    return rank[word], name
        indexed = INDEX.fullmatch(lower)
        if indexed is not None and indexed["stem"] in rank:
            return rank[indexed["stem"]], int(indexed["a"] or indexed["b"] or indexed["c"])
        first, _, last = lower.partition(".") if "." in lower else lower.rpartition("_")
        for word, other in ((first, last), (last, first)):
            if word in rank and other:
                joint = JOINT.fullmatch(other)
                if joint is not None:
                    return rank[word], int(joint["index"])
                if "." in lower:
                    return rank[word], suffix.split(".")[0 if other == first else -1]
        return None

    def _is_complete(self, group: _Group) -> bool:
        return all(name in group.named for name in self.joints) or (
            not any(name in group.named for name in self.joints) and len(self._numbers(group)) >= len(self.joints)
        )

    def _numbers(self, group: _Group) -> list[int]:
        """Joint numbers in a group, without dropped ones."""
        return sorted(number for number in group.numbered if number not in self.dropped_numbers)

    def _joint_columns(self, quantity: str, group: _Group) -> list[Title]:
        for first, second in group.duplicates:
            raise DefinitionError(
                f"{self.source} has two columns for `{quantity}` of one joint, `{plain_name(first.text)}` and "
                f"`{plain_name(second.text)}`: leave one out (`--drop {plain_name(second.text.strip())}`)"
            )
        if all(name in group.named for name in self.joints):
            extra = [name for name in group.named if name not in self.joints and name not in self.reading.drop]
            if extra:
                names = ", ".join(f"`{plain_name(name)}`" for name in extra[:8])
                self.notes.append(f"the arm has no joint {names}: left out")
            return [group.named[name] for name in self.joints]
        numbers = self._numbers(group)
        every = sorted(group.numbered)
        if every != list(range(every[0], every[0] + len(every))) or every[0] not in (0, 1):
            raise DefinitionError(
                f"the columns for `{quantity}` of {self.source} have the numbers {short_repr(every)}: number them from "
                f"0 or 1 without a gap, use joint names instead, or list them, such as `--columns {quantity}=A,B,C`"
            )
        if len(numbers) > len(self.joints):
            raise DefinitionError(
                f"{self.source} has {len(numbers)} columns for `{quantity}`, but the arm has {len(self.joints)} "
                f"joints: leave out those of other joints by their numbers (such as `--drop {numbers[-1]}`)"
            )
        return [group.numbered[number] for number in numbers]

    def _require_missing_is_allowed(
        self, quantity: str, words: Sequence[str], groups: Mapping[tuple[int, str], _Group], choice: str | None
    ) -> None:
        """Raise a DefinitionError with the reason why a quantity is missing, unless it may be missing."""
        nearly = max(groups.values(), key=lambda group: len(group.named) + len(group.numbered), default=_Group())
        known = [name for name in self.joints if name in nearly.named]
        if not known:
            numbers = self._numbers(nearly)
            known = list(self.joints[: len(numbers)])
        if quantity == "dq" and choice is None:
            if not known:
                return
            if self.reading.drop and any(self.fold(word) not in self.keys for word in self.reading.drop):
                self.notes.append("`dq` is left out, since some of its columns are dropped")
                return
        missing = next((name for name in self.joints if name not in known), self.joints[0])
        number = list(self.joints).index(missing) + 1
        remedy = ", or leave `dq` out (`--drop dq`)" if quantity == "dq" else ""
        if choice is not None:
            raise DefinitionError(
                f"{self.source} has no column `{plain_name(choice)}` for joint `{missing}`: each of the "
                f"{len(self.joints)} joints needs one, with its number or name; the columns are {self._some()}"
            )
        if quantity == "tau" and not known:
            self._refuse_other_torques()
        named = any(isinstance(key, str) for group in groups.values() for key in group.named)
        others = [key for group in groups.values() for key in group.named if key not in self.joints]
        near = f"; {nearest_word(missing, list(dict.fromkeys(others))[:50])}" if named and others else ""
        raise DefinitionError(
            f"{self.source} has no `{quantity}` of joint `{missing}`: rename its column to `{quantity}_{number}` or "
            f"`{missing}.{WORDS[quantity][1]}`, or give the titles' word (`--columns {quantity}=WORD`){remedy}; "
            f"the columns are {self._some()}{near}"
        )

    def _refuse_other_torques(self) -> None:
        for words, reason, option, how in (
            (
                CURRENTS,
                "motor currents [A], not torques",
                " --torque-scale A,B,C",
                "multiplied by each joint's N m per A",
            ),
            (COMPUTED, "torques that a controller computed, not measured ones", "", "anyway"),
        ):
            groups = self._groups(words, positions=False)
            for (word, prefix), group in sorted(groups.items(), key=lambda item: item[0]):
                if self._is_complete(group):
                    name = f"{prefix}.{words[word]}".strip(".")
                    raise DefinitionError(
                        f"{self.source} has no torques, only `{name}`: {reason}; `--columns tau={name}{option}` "
                        f"reads them {how}"
                    )
