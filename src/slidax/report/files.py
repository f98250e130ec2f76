"""The log of a run as a Parquet file, and its scenario and parameters as text."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.core.writing import replace_file, write_text
from slidax.scenarios.scenario import Scenario, ScenarioDescription
from slidax.scenarios.yaml_text import as_yaml, dump_yaml
from slidax.simulation.parquet import require_pyarrow
from slidax.simulation.run import Run, columns_of


def write_scenario(description: ScenarioDescription, path: str | Path) -> None:
    """Write a validated `description` to `path` as YAML. Its file names are absolute, so it runs from any folder."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    parts = {name: _with_whole_paths(getattr(description, name)) for name in ("robot", "trajectory")}
    write_text(path, as_yaml(description.model_copy(update=parts)))


def _with_whole_paths(part: Any) -> Any:
    paths: dict[str, Any] = {}
    if isinstance(getattr(part, "file", None), str):
        paths["file"] = str(Path(part.file).resolve())
    if getattr(part, "packages", None):
        paths["packages"] = [str(Path(package).resolve()) for package in part.packages]
    return part.model_copy(update=paths) if paths else part


def parameters(scenario: Scenario) -> dict[str, str]:
    """Return two YAML texts by title: the `scenario`'s description, and its law with the values of all parameters."""
    law = _values(scenario.controller)
    return {"The scenario": as_yaml(scenario.description), "The law with all its values": dump_yaml(law)}


def _values(part: Any) -> Any:
    """Return a module as its class name and fields; a robot, which the scenario describes, as its class name alone."""
    if isinstance(part, AbstractRobot):
        return type(part).__name__
    if isinstance(part, eqx.Module):
        fields = {field.name: _values(getattr(part, field.name)) for field in dataclasses.fields(part)}
        return {"kind": type(part).__name__, **fields}
    if callable(part):
        return getattr(part, "__name__", type(part).__name__)
    if not eqx.is_array(part):
        return part
    values = np.asarray(part)
    return _rounded(values).tolist() if values.dtype.kind == "f" else values.tolist()


def _rounded(values: np.ndarray) -> np.ndarray:
    """Round to six significant digits, which hides the rounding errors of binary numbers."""
    return np.vectorize(lambda value: float(f"{value:.6g}"), otypes=[float])(values)


def columns(run: Run) -> dict[str, np.ndarray]:
    """Return the log of a `run` by column name: `t`, `q_1`, `dq_1`, `q_d_1`, ..., `tau_1`, then envelope and signals.

    Raises DefinitionError if the run has no log.
    """
    numbered = [f"_{joint + 1}" for joint in range(run.joints)]
    return {name: values for name, (values, _) in columns_of(run, numbered).items()}


def write_log(run: Run, path: str | Path) -> None:
    """Write the log of a `run` to `path` as Parquet, with the joints' units in its metadata.

    Raises DefinitionError if the run has no log or pyarrow is not installed.
    """
    require_pyarrow("writing the log")
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table(columns(run))
    units = {"joint_units": ", ".join(run.joint_units), "period": f"{float(run.period)!r} s", "t": "s"}
    with replace_file(path) as file:
        pq.write_table(table.replace_schema_metadata(units), file, compression="zstd")
