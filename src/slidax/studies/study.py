"""Base of all studies: a scenario, its uncertainty, and a seed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from slidax._errors import DefinitionError, located
from slidax.scenarios.base import AbstractDescription
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered_description, described
from slidax.scenarios.uncertainty import AbstractSet
from slidax.scenarios.uncertainty.mapping import Uncertainty

from .result import AbstractResult
from .runner import AbstractPool, Here, Part, Runner
from .store import Store
from .table import COLUMNS
from .task import Task

Progress = Callable[[int], None]


def _unheard(rows: int) -> None:
    """Ignore the progress."""


@dataclass
class How:
    """Options for running a study.

    - `out`: folder of its rows; None keeps them in memory.
    - `resume`: True to continue with the rows in `out`.
    - `pool`: where rows are computed.
    - `begin`: called with the largest number of rows.
    - `progress`: called with the number of new rows.
    - `made_by`: software and machine, for the folder.
    - `part`: the chunks that are computed here, into a folder that several processes share; None for all.
    """

    out: Path | None = None
    resume: bool = False
    pool: AbstractPool = field(default_factory=Here)
    begin: Progress = _unheard
    progress: Progress = _unheard
    made_by: dict[str, Any] = field(default_factory=dict)
    part: Part | None = None


class AbstractStudy(AbstractDescription):
    """Base of all studies."""

    of_rows: ClassVar[tuple[str, ...]] = ("seed",)
    """Fields that the values of rows depend on, in addition to the scenario and its sets."""
    in_parts: ClassVar[bool] = False
    """True if all rows are known beforehand, so that several processes can share them."""
    study: Any
    title: str = ""
    """One line for a person."""
    scenario: str
    """Name of a built-in scenario, or path of a file, from the folder of the study."""
    changes: dict[str, Any] = Field(default={})
    """Values of the scenario by path, as `--set` has them."""
    uncertainty: Uncertainty = Field(default={})
    """Sets by path, on top of those of the scenario."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Another seed draws other cases."""
    engine: Literal["auto", "native", "xla", "cuda"] | None = None
    """Engine; by default the scenario's own."""

    @abstractmethod
    def run(self, how: How) -> AbstractResult:
        """Run the study.

        - `how`: options.
        """

    def described(self) -> ScenarioDescription:
        """The scenario with its changes."""
        with located("scenario"):
            base = described(self.scenario)
        if not self.changes:
            return base
        with located("changes"):
            return altered_description(base, self.changes)

    def sets(self, base: ScenarioDescription) -> dict[str, AbstractSet]:
        """All that is uncertain.

        - `base`: the scenario.
        """
        return {**base.uncertainty, **self.uncertainty}

    def family(self, varied: dict[str, AbstractSet] | None = None) -> Family:
        """The scenarios that it is about.

        - `varied`: sets of what the law is told, too.

        Raises DefinitionError, with the path, if a set is empty, or a value out of its range.
        """
        base = self.described()
        return Family.of(base, self.sets(base), varied or {})

    def runner(self, family: Family, how: How) -> Runner:
        """Return the runner of the rows.

        - `family`: of scenarios.
        - `how`: as in `run`.
        """
        self.require_parts(how)
        task = Task.of(family, self.engine)
        simulation = family.base.simulation
        chunk = Runner.rows_of_chunk(round(simulation.t1 / simulation.period))
        store = None
        if how.out is not None:
            text = self.model_dump(mode="json", include={"study", *self.of_rows})
            identity = {**text, **task.content, "chunk": chunk, "made_by": how.made_by}
            # Who computes a part joins the others.
            store = Store(how.out, identity, resume=how.resume or how.part is not None, notes=COLUMNS)
        return Runner(task, chunk, store, how.pool, how.progress, how.part)

    def require_parts(self, how: How) -> None:
        """Raise DefinitionError if a part is to be computed of a study that cannot be shared, or without a folder.

        - `how`: as in `run`.
        """
        if how.part is None:
            return
        if how.out is None:
            raise DefinitionError("`--part` needs the folder that the processes share: --out DIR")
        if not self.in_parts or getattr(self, "until", None) is not None:
            kind = self.study if not self.in_parts else f"{self.study} with `until`"
            raise DefinitionError(
                f"`--part` is for studies whose rows are all known beforehand; {kind} chooses each row by the ones "
                "before: leave `--part` out, or use --cluster"
            )

    def require(self, holds: bool, where: str, message: str) -> None:
        """Raises DefinitionError at a field unless something holds.

        - `holds`: whether it does.
        - `where`: the field.
        - `message`: what must hold, and what is given.
        """
        if not holds:
            raise DefinitionError(message, where=where)
