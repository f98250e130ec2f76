"""Options for reading a log whose column names leave something open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from slidax._errors import DefinitionError, plain

QUANTITIES = ("t", "q", "dq", "tau")


@dataclass(frozen=True)
class Reading:
    """Options for reading a log whose column names leave something open.

    - `topic`: of the messages, where a log has several with joint states.
    - `columns`: for `t`, `q`, `dq` or `tau`, the word that its columns have in their titles, or a title per joint.
    - `drop`: quantities (`dq`), columns, joints by name, or joints by their number in the log, that are left out.

    Raises DefinitionError if a quantity is none of these, or one that is needed is dropped.
    """

    topic: str | None = None
    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    drop: Sequence[str] = ()

    def __post_init__(self) -> None:
        for quantity in self.columns:
            if quantity not in QUANTITIES:
                raise DefinitionError(
                    f"`columns` has the quantity `{plain(quantity)}`, but there are only `t`, `q`, `dq` and `tau`: "
                    "write it such as `q=position,tau=effort`"
                )
        for needed in ("t", "q", "tau"):
            if needed in self.drop:
                raise DefinitionError(f"`drop` names `{needed}`, which identification needs; only `dq` may be left out")


def parse_columns(texts: Sequence[str]) -> dict[str, str | list[str]]:
    """Return the quantities and their columns, from texts such as `q=position,tau=effort` or `tau=a,b,c`.

    - `texts`: each with one or more quantities.

    Raises DefinitionError if a text has another form.
    """
    columns: dict[str, list[str]] = {}
    for text in texts:
        quantity = None
        for part in text.split(","):
            name, sign, word = part.partition("=")
            if sign:
                quantity = name.strip()
                columns.setdefault(quantity, []).append(word.strip())
            elif quantity is not None:
                columns[quantity].append(part.strip())
            if not quantity or not columns[quantity][-1]:
                raise DefinitionError(
                    f"`--columns {plain(text)}` needs the form QUANTITY=COLUMN, such as `q=position,tau=effort`"
                )
    return {quantity: words[0] if len(words) == 1 else words for quantity, words in columns.items()}
