"""Every reader of files, each with a file that it reads."""

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import slidax as sx
from slidax.scenarios.load import BUILT_IN

from . import whole_files as whole
from .whole_files import JOINTS, ROOT


@dataclass(frozen=True)
class Reader:
    """A reader with its file below a folder, a whole content, and files that `prepare` puts next to it."""

    name: str
    file: str
    content: Callable[[], bytes]
    read: Callable[[Path], Any]
    text: bool = True
    prepare: Callable[[Path], None] = lambda folder: None


def read_mesh(path):
    from slidax.arms.files import Shape
    from slidax.report.replay import shapes

    shape = Shape("a", "mesh", np.eye(4), np.ones(3), None, path.name, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            return shapes._meshes(shape)
    except sx.DefinitionError:
        raise
    except Exception:
        # `mesh_solids` names such a mesh in a warning.
        return None


def log_of(path):
    from slidax.identify import read_log

    return read_log(path, JOINTS)


def replayed(path):
    from slidax.runtime.logs import read_mcap
    from slidax.scenarios import restore

    log = read_mcap(path)
    return restore(log.scenario, log.files, log.name)


def explained(path):
    from slidax.analysis import read_saved

    return read_saved(path.parent)


def with_scenario(folder):
    (folder / "scenario.yaml").write_bytes((BUILT_IN / "example-4.1-1khz.yaml").read_bytes())


def with_mcap(folder):
    (folder / "bag_0.mcap").write_bytes(whole.bag_mcap())


def with_metadata(folder):
    (folder / "metadata.yaml").write_text(whole.BAG_METADATA, encoding="utf-8")


def example(name):
    return (ROOT / "examples" / name).read_bytes


def all_readers():
    from slidax.design import read_problem
    from slidax.motions import Through
    from slidax.motions.table_files import csv_table, joint_trajectory_table
    from slidax.scenarios import draft, named_robot
    from slidax.scenarios.load import read_description
    from slidax.studies import read_rows, read_study
    from slidax.studies.store import read_identity

    def folder(path):
        return log_of(path.parent)

    def rows(path):
        return read_rows(path.parent)

    yield Reader("scenario", "a.yaml", (BUILT_IN / "example-4.1-1khz.yaml").read_bytes, read_description)
    yield Reader("tool path scenario", "a.yaml", (BUILT_IN / "panda-pick.yaml").read_bytes, read_description)
    yield Reader("study", "a.yaml", example("studies/example-4.1-1khz.yaml"), read_study)
    yield Reader("requirements", "a.yaml", example("design/two-link.yaml"), read_problem)
    yield Reader("motion", "a.csv", whole.motion_csv, lambda path: csv_table(path, JOINTS))
    yield Reader("semicolon motion", "a.csv", whole.semicolon_motion, lambda path: csv_table(path, JOINTS))
    yield Reader(
        "joint trajectory", "a.json", whole.joint_trajectory, lambda path: joint_trajectory_table(path, JOINTS)
    )
    yield Reader("tool path", "a.csv", whole.path_csv, Through.from_csv)
    yield Reader("urdf", "a.urdf", example("robots/two_link.urdf"), sx.arms.from_urdf)
    yield Reader("mjcf", "a.xml", example("robots/two_link.xml"), sx.arms.from_mjcf)
    yield Reader("drawn urdf", "a.urdf", example("robots/two_link.urdf"), draft)
    yield Reader("robot", "a.yaml", lambda: b"robot: {kind: panda}\n", lambda path: named_robot(str(path)))
    yield Reader("stl mesh", "a.stl", whole.mesh_stl, read_mesh, text=False)
    yield Reader("obj mesh", "a.obj", whole.mesh_obj, read_mesh)
    yield Reader("dae mesh", "a.dae", whole.mesh_dae, read_mesh)
    yield Reader("csv log", "a.csv", whole.csv_log, log_of)
    yield Reader("semicolon log", "a.csv", whole.semicolon_log, log_of)
    yield Reader("dated log", "a.csv", whole.dated_log, log_of)
    yield Reader("json log", "a.json", lambda: json.dumps(whole.messages()).encode(), log_of)
    yield Reader("jsonl log", "a.jsonl", lambda: "\n".join(map(json.dumps, whole.messages())).encode(), log_of)
    yield Reader("parquet log", "a.parquet", whole.parquet_log, log_of, text=False)
    yield Reader("packed parquet log", "a.parquet", lambda: whole.parquet_log("snappy"), log_of, text=False)
    yield Reader("mcap log", "a.mcap", whole.bag_mcap, log_of, text=False)
    yield Reader("chunked mcap log", "a.mcap", lambda: whole.bag_mcap(chunked=True), log_of, text=False)
    yield Reader("zstd mcap log", "a.mcap", lambda: whole.bag_mcap("ZSTD", chunked=True), log_of, text=False)
    yield Reader("lz4 mcap log", "a.mcap", lambda: whole.bag_mcap("LZ4", chunked=True), log_of, text=False)
    yield Reader("bag database", "a.db3", whole.bag_database, log_of, text=False)
    yield Reader("bag metadata", "bag/metadata.yaml", whole.BAG_METADATA.encode, folder, prepare=with_mcap)
    yield Reader("bag folder", "bag/bag_0.mcap", whole.bag_mcap, folder, text=False, prepare=with_metadata)
    yield Reader("own log", "a.mcap", whole.own_log, replayed, text=False)
    yield Reader("own log to explain", "a.mcap", whole.own_log, lambda path: explained(path / "x"), text=False)
    yield Reader("saved run", "run/log.parquet", whole.saved_run, explained, text=False, prepare=with_scenario)
    yield Reader("rows", "study/rows.parquet", lambda: whole.parquet_log("zstd"), rows, text=False)
    yield Reader(
        "identity", "study/study.json", lambda: b'{"scenario": {"a": 1}}', lambda path: read_identity(path.parent)
    )
