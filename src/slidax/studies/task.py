"""Task of a study as text, from which another process computes the rows."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from pydantic import TypeAdapter

from slidax.scenarios.family import Family
from slidax.scenarios.load import validated
from slidax.scenarios.uncertainty.mapping import Uncertainty

from .cases import Cases, Values
from .table import Columns


@dataclass(frozen=True)
class Task:
    """A family of scenarios as text.

    - `text`: JSON with the scenario's description, its sets, and the engine.
    """

    text: str

    @classmethod
    def of(cls, family: Family, engine: str | None = None) -> Task:
        """The task of a family; `engine` as in `simulate`, the scenario's own if None."""
        base = family.base.model_dump(mode="json", exclude_unset=True, exclude={"uncertainty"})
        sets = [
            {path: item.model_dump(mode="json", exclude_unset=True) for path, item in space.sets.items()}
            for space in (family.uncertain, family.varied)
        ]
        text = {"scenario": base, "uncertain": sets[0], "varied": sets[1], "engine": engine}
        return cls(json.dumps(text, sort_keys=False, ensure_ascii=False))

    @property
    def content(self) -> dict[str, Any]:
        """Values in the text."""
        return json.loads(self.text)

    @property
    def digest(self) -> str:
        """Hash of all that the rows depend on, except their values."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    def cases(self, threads: int | None = None) -> Cases:
        """Return the cases; the same object for the same text, so that a process compiles once.

        - `threads`: of the native engine.
        """
        return _cases(self.text, threads)

    def run(self, values: Values, threads: int | None = None) -> Columns:
        """Outcome and metrics of cases, wherever this is called.

        - `values`: by path, with the case first.
        - `threads`: of the native engine.
        """
        jax.config.update("jax_enable_x64", True)
        return self.cases(threads).run(values)


@functools.lru_cache(maxsize=8)
def _cases(text: str, threads: int | None) -> Cases:
    parts = json.loads(text)
    sets = TypeAdapter(Uncertainty)
    family = Family.of(
        validated(parts["scenario"]), sets.validate_python(parts["uncertain"]), sets.validate_python(parts["varied"])
    )
    return Cases(family, parts["engine"], threads)


def flat(values: Mapping[str, Any]) -> Columns:
    """Values as columns, one for each number: `robot.plant.coulomb[0]`.

    - `values`: by path, with the case first.
    """
    columns: Columns = {}
    for path, array in values.items():
        inputs = np.asarray(array)
        if inputs.ndim == 1:
            columns[path] = inputs
            continue
        for place in np.ndindex(inputs.shape[1:]):
            columns[f"{path}[{','.join(map(str, place))}]"] = inputs[(slice(None), *place)]
    return columns
