"""Logs in Parquet files of other tools: the types of their columns."""

from __future__ import annotations

import numpy as np
import pytest

from slidax import DefinitionError
from slidax.identify import read_log

from .test_log_columns import ARM, PLAIN, TAU, K, Q, T, assert_read

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_parquet_timestamps_are_read_by_their_unit(tmp_path, unit):
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    t = np.arange(K) * (1.0 if unit == "s" else 0.004)
    stamps = pa.array(1_700_000_000 * ticks + np.round(t * ticks).astype(np.int64), pa.timestamp(unit, tz="UTC"))
    columns = dict(zip(PLAIN[1:], np.column_stack([Q, TAU]).T, strict=True))
    pq.write_table(pa.table({"time": stamps, **columns}), tmp_path / "a.parquet")
    log = read_log(tmp_path / "a.parquet", ARM)
    assert_read(log, t=t)
    # Parquet has no timestamps in s.
    assert f"timestamp[{unit if unit != 's' else 'ms'}" in log.notes[0]


def test_parquet_types_are_converted_knowingly(tmp_path):
    columns = {"time": pa.array(T), **dict(zip(PLAIN[1:], map(pa.array, np.column_stack([Q, TAU]).T), strict=True))}
    columns["q_1"] = columns["q_1"].cast(pa.decimal128(20, 12))
    columns["q_2"] = columns["q_2"].dictionary_encode()
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    assert_read(read_log(tmp_path / "a.parquet", ARM))
    for kind, wrong in (("bool", [True] * K), ("string", ["1"] * K), ("timestamp", np.zeros(K, "datetime64[us]"))):
        pq.write_table(pa.table({**columns, "tau_3": pa.array(wrong)}), tmp_path / "a.parquet")
        with pytest.raises(DefinitionError, match=f"column `tau_3` has .*{kind}"):
            read_log(tmp_path / "a.parquet", ARM)
    pq.write_table(
        pa.table({**columns, "tau_3": pa.array([1.0] * 7 + [None] + [1.0] * (K - 8))}), tmp_path / "a.parquet"
    )
    with pytest.raises(DefinitionError, match="column `tau_3` has no value in row 8"):
        read_log(tmp_path / "a.parquet", ARM)


def test_names_in_a_list_say_which_joint_the_numbers_are_of(tmp_path):
    names, places = ["wrist", "finger", "shoulder", "elbow"], [2, 0, 0, 1]
    columns = {"time": T, "position": Q[:, places].tolist(), "effort": TAU[:, places].tolist()}
    pq.write_table(pa.table({**columns, "name": [names] * K}), tmp_path / "a.parquet")
    log = read_log(tmp_path / "a.parquet", ARM)
    assert_read(log)
    assert log.notes == ("the arm has no joint `finger`: left out",)
    pq.write_table(pa.table({**columns, "name": [names] * (K - 1) + [names[::-1]]}), tmp_path / "a.parquet")
    with pytest.raises(DefinitionError, match="names in column `name` differ from row to row"):
        read_log(tmp_path / "a.parquet", ARM)


def test_lists_in_parquet_are_vectors(tmp_path):
    pq.write_table(pa.table({"time": T, "position": Q.tolist(), "effort": TAU.tolist()}), tmp_path / "a.parquet")
    assert_read(read_log(tmp_path / "a.parquet", ARM))
