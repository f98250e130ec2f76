"""Logs from files: CSV, our Parquet, messages of ROS."""

import json
import sys

import numpy as np
import pytest

import slidax as sx
from slidax.analysis import read_saved
from slidax.core.errors import DefinitionError
from slidax.identify import read_log
from tests.identify.recorded import recorded

ARM = sx.arms.ur5e()
LOG = recorded(ARM, seconds=2.0)
N = range(6)
TITLES = ["time", *(f"q{i + 1}" for i in N), *(f"tau{i + 1}" for i in N)]


def table(titles, path):
    values = np.column_stack([LOG.t, LOG.q, LOG.tau])
    lines = [",".join(titles), *(",".join(f"{x:.17g}" for x in row) for row in values)]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "titles",
    [
        TITLES,
        ["t [s]", *(f"q_{i + 1} [rad]" for i in N), *(f"tau_{i + 1} [N m]" for i in N)],
        ["time", *ARM.joint_names, *(f"{name}.effort" for name in ARM.joint_names)],
        ["time", *(f"{name}.position" for name in ARM.joint_names), *(f"{name}.torque" for name in ARM.joint_names)],
    ],
    ids=["numbers", "units", "names", "words"],
)
def test_csv_columns_are_assigned_by_their_titles(tmp_path, titles):
    read = read_log(table(titles, tmp_path / "log.csv"), ARM.joint_names)
    np.testing.assert_array_equal(read.q, LOG.q)
    np.testing.assert_array_equal(read.tau, LOG.tau)
    assert read.dq is None and read.period == pytest.approx(0.004)


@pytest.mark.parametrize("lines", [True, False])
def test_joint_states_are_read_in_the_arms_order(tmp_path, lines):
    names = list(reversed(ARM.joint_names))
    messages = [
        {
            "header": {"stamp": {"sec": 1700000000 + int(t), "nanosec": round(1e9 * (t % 1))}},
            "name": [*names, "finger"],
            "position": [*q[::-1], 0.0],
            "velocity": [],
            "effort": [*tau[::-1], 0.0],
        }
        for t, q, tau in zip(LOG.t, LOG.q.tolist(), LOG.tau.tolist(), strict=True)
    ]
    path = tmp_path / ("log.jsonl" if lines else "log.json")
    path.write_text("\n".join(map(json.dumps, messages)) if lines else json.dumps(messages), encoding="utf-8")
    read = read_log(path, ARM.joint_names)
    np.testing.assert_array_equal(read.q, LOG.q)
    np.testing.assert_array_equal(read.tau, LOG.tau)
    np.testing.assert_allclose(read.t, LOG.t, atol=1e-6)


def test_parquet_log_with_the_columns_of_slidax_is_read(tmp_path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    dq = np.gradient(LOG.q, LOG.t, axis=0)
    parts = {"q": LOG.q, "dq": dq, "q_d": LOG.q, "e": 0.0 * LOG.q, "tau": LOG.tau, "s": LOG.q}
    columns = {f"{name}_{i + 1}": values[:, i] for name, values in parts.items() for i in N}
    pq.write_table(pa.table({"k": np.arange(len(LOG.t)), "t": LOG.t, **columns}), tmp_path / "log.parquet")
    read = read_log(tmp_path / "log.parquet", ARM.joint_names)
    for column, expected in ((read.q, LOG.q), (read.tau, LOG.tau), (read.dq, dq)):
        np.testing.assert_array_equal(column, expected)


@pytest.mark.parametrize(
    ("name", "table_of", "words"),
    [
        ("text", lambda pa: None, "cannot read the file .*text.parquet`: "),
        ("twice", lambda pa: pa.table([[0.0], [1.0]], names=["t", "t"]), "has two columns `t`"),
        (
            "words",
            lambda pa: pa.table({name: ["a", "b"] for name in TITLES}),
            "column `time` has the type string, which is not numeric",
        ),
    ],
)
def test_an_invalid_parquet_file_is_refused_with_the_reason(tmp_path, name, table_of, words):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / f"{name}.parquet"
    table = table_of(pa)
    path.write_text("no table", encoding="utf-8") if table is None else pq.write_table(table, path)
    with pytest.raises(DefinitionError, match=words):
        read_log(path, ARM.joint_names)


@pytest.mark.parametrize("reader", [lambda path: read_log(path, ARM.joint_names), lambda path: read_saved(path.parent)])
def test_reading_parquet_without_pyarrow_names_the_extra_to_install(tmp_path, monkeypatch, reader):
    for name in ("log.parquet", "scenario.yaml"):
        (tmp_path / name).touch()
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(DefinitionError, match=r"reading the log needs pyarrow.*pip install 'slidax\[parquet\]'"):
        reader(tmp_path / "log.parquet")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("log.doc", "", "name must end in .csv, .tsv, .txt, .parquet, .json, .jsonl"),
        ("log.csv", "", "is empty"),
        ("log.csv", "when,q1\n1,2", "no time column"),
        ("log.csv", "time,q1,q2,q3,q4,q5,q6\n", "no `tau` of joint `shoulder_pan_joint`"),
        ("log.csv", "time,q1,q2,q3,q4,q5,q6,tau1\n", "no `tau` of joint `shoulder_lift_joint`"),
        ("log.json", "{", "not JSON"),
        ("log.json", "[]", "has no messages"),
        ("log.json", '[{"name": ["a"]}]', "none of the arm's joints, such as `shoulder_pan_joint`"),
        ("log.json", "[3]", "has a list `name`"),
    ],
)
def test_an_invalid_log_file_is_refused_with_the_reason(tmp_path, name, text, words):
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(DefinitionError, match=words):
        read_log(tmp_path / name, ARM.joint_names)
