"""A study as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field, TypeAdapter, ValidationError

from slidax._errors import DefinitionError
from slidax.scenarios.mistakes import translated
from slidax.scenarios.yaml_text import read_yaml_file, require_readable

from .compare import Compare
from .falsify import Falsify
from .monte_carlo import MonteCarlo
from .sensitivity import Sensitivity
from .study import AbstractStudy
from .sweep import Sweep
from .tune import Tune

KINDS: tuple[type[AbstractStudy], ...] = (MonteCarlo, Sweep, Falsify, Sensitivity, Tune, Compare)
"""The kinds of studies, in the order of their use."""

if TYPE_CHECKING:
    AnyStudy = AbstractStudy
else:
    AnyStudy = Annotated[Union[KINDS], Field(discriminator="study")] if len(KINDS) > 1 else KINDS[0]  # noqa: UP007


def read_study(path: str | Path, changes: dict[str, Any] | None = None) -> AbstractStudy:
    """The study in a YAML file.

    - `path`: of the file; scenarios and files that it names are found from its folder.
    - `changes`: values of its own fields by name, such as `{"runs": 100}`.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    path = Path(path)
    return study_of(read_yaml_file(path, "the study file"), changes, folder=path.parent)


def study_of(data: Any, changes: dict[str, Any] | None = None, *, folder: Path = Path()) -> AbstractStudy:
    """The study that a mapping says.

    - `data`: mappings, lists and values.
    - `changes`: as in `read_study`.
    - `folder`: from where files are found.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a study is a mapping with the keys study, scenario, uncertainty, ...")
    require_readable(data)
    data = {**data, **(changes or {})}
    scenario = data.get("scenario")
    if isinstance(scenario, str) and Path(scenario).suffix in (".yaml", ".yml"):
        data["scenario"] = str(folder / scenario)
    try:
        result: AbstractStudy = TypeAdapter(AnyStudy).validate_python(data, context={"folder": folder})
    except ValidationError as error:
        raise translated(error, data) from None
    return result
