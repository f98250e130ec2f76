"""Tables of other tools, as text and Parquet: titles, separators, decimal signs, units, types and times."""

import numpy as np
import pytest

from slidax import DefinitionError
from slidax.identify import Conventions, parse_columns, read_log

ARM = ("shoulder", "elbow", "wrist")
K, N = 250, len(ARM)
T = np.round(0.004 * np.arange(K), 6)
Q = np.round(0.4 * np.sin(np.outer(T, [2.0, 3.0, 5.0]) + np.array([0.1, 0.2, 0.3])), 5)
DQ = np.round(np.cos(np.outer(T, [2.0, 3.0, 5.0])), 5)
TAU = np.round(9.0 * np.cos(np.outer(T, [1.0, 4.0, 2.0])), 5)
LONG = ("joint_a1", "joint_a2", "joint_a3", "joint_a4")


def numbered(word: str, form: str, first: int = 1) -> list[str]:
    return [form.format(word=word, k=first + k) for k in range(N)]


def write(path, titles, values=None, *, separator=",", comma=False, times=None, end="\n"):
    values = np.column_stack([T, Q, TAU]) if values is None else values
    rows = [[f"{x:.10g}" for x in row] for row in values]
    if times is not None:
        rows = [[time, *row[1:]] for time, row in zip(times, rows, strict=True)]
    if comma:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    lines = [separator.join(titles), *(separator.join(row) for row in rows)]
    path.write_text(end.join(lines), encoding="utf-8")
    return path


def assert_read(log, *, q=Q, tau=TAU, t=T):
    np.testing.assert_allclose(log.t, t - t[0] if abs(t[0]) > 1e6 else t, atol=1e-9)
    np.testing.assert_allclose(log.q, q, atol=1e-12)
    np.testing.assert_allclose(log.tau, tau, atol=1e-12)


PLAIN = ["time", *numbered("q", "{word}_{k}"), *numbered("tau", "{word}_{k}")]


@pytest.mark.parametrize(
    ("separator", "comma"),
    [(",", False), (";", False), (";", True), ("\t", False), ("\t", True), (" ", False), (" ", True)],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["unix", "windows", "mac"])
def test_separator_and_decimal_sign_are_recognised(tmp_path, separator, comma, end):
    assert_read(read_log(write(tmp_path / "a.csv", PLAIN, separator=separator, comma=comma, end=end), ARM))


def test_columns_may_be_aligned_by_spaces(tmp_path):
    values = np.column_stack([T, Q, TAU])
    lines = ["".join(f"{title:>12}" for title in PLAIN), *("".join(f"{x:12.5f}" for x in row) for row in values)]
    (tmp_path / "a.txt").write_text("\n".join(lines), encoding="utf-8")
    assert_read(read_log(tmp_path / "a.txt", ARM))


def test_decimal_commas_in_quotation_marks_are_read(tmp_path):
    path = write(tmp_path / "a.csv", PLAIN, separator=";", comma=True)
    lines = [",".join(f'"{cell}"' for cell in line.split(";")) for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines))
    assert_read(read_log(path, ARM))


def test_column_titles_in_a_comment_of_numpy_savetxt_are_read(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.column_stack([T, Q, TAU]), header=" ".join(PLAIN), fmt="%.10g")
    assert_read(read_log(tmp_path / "a.txt", ARM))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_text_encodings_of_spreadsheet_programs_are_read(tmp_path, encoding):
    path = write(tmp_path / "a.csv", PLAIN, separator="\t")
    path.write_bytes(path.read_text().encode(encoding))
    assert_read(read_log(path, ARM))


@pytest.mark.parametrize(
    "titles",
    [
        ["time", *numbered("q", "state.{word}[{k}]", 0), *numbered("tau_J", "state.{word}[{k}]", 0)],
        ["timestamp", *numbered("actual_q", "{word}_{k}", 0), *numbered("tau", "{word}_{k}", 0)],
        [
            "__time",
            *(f"/joint_states/{name}/position" for name in ARM),
            *(f"/joint_states/{name}/effort" for name in ARM),
        ],
        ["Time", *numbered("position", "{word}_{k}", 0), *numbered("effort", "{word}_{k}", 0)],
        ["t", *numbered("q", "Joint {k} {word}"), *numbered("torque", "Joint {k} {word}")],
        ["t", *(f"pos_{name}" for name in ARM), *(f"torque_{name.upper()}" for name in ARM)],
        ["t", *(f"{name}.q" for name in ARM), *(f"tau/{name}" for name in ARM)],
    ],
    ids=["libfranka", "rtde", "plotjuggler", "bagpy", "joint 1", "word first", "paths"],
)
def test_column_titles_of_other_tools_are_recognised(tmp_path, titles):
    assert_read(read_log(write(tmp_path / "a.csv", titles), ARM))


def test_libfrankas_own_log_is_read_with_its_times_in_milliseconds(tmp_path):
    """As `franka::logToCSV` writes it: measured and commanded columns, and a rate of success next to the time."""
    parts = {
        "state.q": Q,
        "state.q_d": Q + 1,
        "state.dq": DQ,
        "state.dq_d": DQ + 1,
        "state.tau_J": TAU,
        "cmd.q_d": Q + 2,
    }
    titles = ["time", "success_rate", *(title for word in parts for title in numbered(word, "{word}[{k}]", 0))]
    values = np.column_stack([1000 * T, np.ones(K), *parts.values()])
    log = read_log(write(tmp_path / "a.csv", titles, values), ARM)
    assert_read(log)
    np.testing.assert_allclose(log.dq, DQ)
    assert "milliseconds, as libfranka writes them" in " ".join(log.notes)


def test_columns_in_alphabetical_order_are_assigned_by_joint_names(tmp_path):
    order = sorted(range(N), key=ARM.__getitem__)
    titles = ["time", *(f"{ARM[k]}.position" for k in order), *(f"{ARM[k]}.effort" for k in order)]
    assert_read(read_log(write(tmp_path / "a.csv", titles, np.column_stack([T, Q[:, order], TAU[:, order]])), ARM))


def echoed(path, names):
    """A table as `rostopic echo -p` writes it, with the joints' names in each line."""
    n = len(names)
    titles = ["%time", *(f"field.{word}{k}" for word in ("name", "position", "effort") for k in range(n))]
    places = [ARM.index(name) for name in names]
    rows = [
        ",".join([f"{1e9 * t:.0f}", *names, *(f"{x:.10g}" for x in (*Q[k, places], *TAU[k, places]))])
        for k, t in enumerate(T)
    ]
    path.write_text("\n".join([",".join(titles), *rows]))
    return path


def test_joint_names_in_columns_assign_values_to_joints(tmp_path):
    path = echoed(tmp_path / "a.csv", ["wrist", "shoulder", "elbow"])
    assert_read(read_log(path, ARM))
    path.write_text(path.read_text()[::-1].replace("wrist"[::-1], "wirst"[::-1], 1)[::-1])
    with pytest.raises(DefinitionError, match="line 251: the names of the joints differ from those above"):
        read_log(path, ARM)


def test_a_list_of_joint_names_in_a_column_assigns_values_to_joints(tmp_path):
    """As bagpy writes it."""
    order = [2, 0, 1]
    titles = ["Time", "name", *numbered("position", "{word}_{k}", 0), *numbered("effort", "{word}_{k}", 0)]
    names = str([ARM[k] for k in order])
    rows = [
        f'{t:g},"{names}",' + ",".join(f"{x:.10g}" for x in (*Q[k, order], *TAU[k, order])) for k, t in enumerate(T)
    ]
    (tmp_path / "a.csv").write_text("\n".join([",".join(titles), *rows]))
    assert_read(read_log(tmp_path / "a.csv", ARM))


def test_column_of_another_joint_is_left_out_and_named(tmp_path):
    titles = ["time", "finger.position", *(f"{name}.position" for name in ARM), *(f"{name}.effort" for name in ARM)]
    path = write(tmp_path / "a.csv", titles, np.column_stack([T, T, Q, TAU]))
    log = read_log(path, ARM)
    assert_read(log)
    assert log.notes == ("the arm has no joint `finger`: left out",)
    assert read_log(path, ARM, drop=["finger"]).notes == ()


def test_more_numbered_columns_than_joints_are_refused(tmp_path):
    titles = ["time", *(f"q[{k}]" for k in range(4)), *(f"tau[{k}]" for k in range(4))]
    path = write(tmp_path / "a.csv", titles, np.column_stack([T, T, Q, T, TAU]))
    with pytest.raises(DefinitionError, match=r"4 columns for `q`, but the arm has 3 joints.*--drop 3"):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, drop=["0"]))


def test_column_numbers_that_skip_a_joint_are_refused(tmp_path):
    titles = ["time", "q_1", "q_2", "q_4", "tau_1", "tau_2", "tau_4"]
    with pytest.raises(DefinitionError, match=r"numbers \[1, 2, 4\].*--columns q=A,B,C"):
        read_log(write(tmp_path / "a.csv", titles), ARM)
    assert_read(read_log(tmp_path / "a.csv", ARM, columns=parse_columns(["q=q_1,q_2,q_4,tau=tau_1,tau_2,tau_4"])))


def test_measured_column_is_preferred_to_a_command_of_the_same_name(tmp_path):
    titles = [
        "time",
        *numbered("q", "cmd.{word}[{k}]"),
        *numbered("q", "state.{word}[{k}]"),
        *numbered("tau", "{word}{k}"),
    ]
    assert_read(read_log(write(tmp_path / "a.csv", titles, np.column_stack([T, Q + 1, Q, TAU])), ARM))


def test_a_table_with_two_arms_is_refused_without_a_choice_of_columns(tmp_path):
    titles = ["time", *(f"{side}.{word}{k}" for side in ("left", "right") for word in ("q", "tau") for k in (1, 2, 3))]
    path = write(tmp_path / "a.csv", titles, np.column_stack([T, Q + 1, TAU + 1, Q, TAU]))
    with pytest.raises(DefinitionError, match=r"several columns for `q`: `left.q`, `right.q`.*`--columns q=left.q`"):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, columns={"q": "right.q", "tau": "right.tau"}))


def test_currents_are_not_taken_for_torques(tmp_path):
    titles = ["timestamp", *numbered("actual_q", "{word}_{k}", 0), *numbered("actual_current", "{word}_{k}", 0)]
    path = write(tmp_path / "a.csv", titles, separator=" ")
    with pytest.raises(
        DefinitionError, match=r"motor currents \[A\], not torques.*`--columns tau=actual_current --torque-scale A,B,C`"
    ):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, columns=parse_columns(["tau=actual_current"])))


def test_torques_that_a_controller_computed_are_not_taken_for_measured_torques(tmp_path):
    titles = ["timestamp", *numbered("actual_q", "{word}_{k}", 0), *numbered("target_moment", "{word}_{k}", 0)]
    with pytest.raises(DefinitionError, match=r"a controller computed.*`--columns tau=target_moment`"):
        read_log(write(tmp_path / "a.csv", titles), ARM)


@pytest.mark.parametrize("prefix", ["cmd", "desired", "error", "controller.reference"])
def test_command_columns_are_not_taken_for_measurements(tmp_path, prefix):
    titles = ["time", *(f"{prefix}.positions[{k}]" for k in range(N)), *numbered("effort", "{word}[{k}]", 0)]
    path = write(tmp_path / "a.csv", titles)
    with pytest.raises(DefinitionError, match=rf"no measured `q`, only `({prefix}.position)`; `--columns q=\1`"):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, columns={"q": f"{prefix}.position"}))


def test_commanded_velocities_are_left_out(tmp_path):
    titles = ["time", *PLAIN[1:4], *numbered("dq", "cmd.{word}[{k}]", 0), *PLAIN[4:]]
    log = read_log(write(tmp_path / "a.csv", titles, np.column_stack([T, Q, DQ, TAU])), ARM)
    assert log.dq is None and log.notes == ("`cmd.dq` is a command, not a measurement: it is left out",)


def test_two_columns_for_the_same_joint_are_refused(tmp_path):
    path = write(tmp_path / "a.csv", [*PLAIN, "q1"], np.column_stack([T, Q, TAU, Q[:, 0] + 1]))
    with pytest.raises(DefinitionError, match=r"two columns for `q` of one joint, `q_1` and `q1`.*--drop q1"):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, drop=["q1"]))


@pytest.mark.parametrize(
    ("time", "factor"),
    [("time [ms]", 1e-3), ("time_us", 1e-6), ("timestamp_ns", 1e-9), ("t (s)", 1.0), ("%time", 1e-9)],
)
def test_time_unit_in_a_column_title_is_applied(tmp_path, time, factor):
    log = read_log(write(tmp_path / "a.csv", [time, *PLAIN[1:]], np.column_stack([T / factor, Q, TAU])), ARM)
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    assert len(log.notes) == (factor != 1.0)


def test_units_in_other_column_titles_are_applied(tmp_path):
    titles = ["time", *numbered("q", "{word}_{k} [deg]"), *numbered("tau", "{word}_{k} (mN m)")]
    path = write(tmp_path / "a.csv", titles, np.column_stack([T, np.rad2deg(Q), 1e3 * TAU]))
    log = read_log(path, ARM)
    np.testing.assert_allclose(log.q, Q, atol=1e-8)
    np.testing.assert_allclose(log.tau, TAU, atol=1e-8)
    assert len(log.notes) == 2


def test_unit_of_another_quantity_is_refused(tmp_path):
    titles = ["time", *PLAIN[1:4], *numbered("tau", "{word}_{k} [A]")]
    with pytest.raises(DefinitionError, match=r"column `tau_1 \[A\]` is in `A`, an unknown unit of `tau`"):
        read_log(write(tmp_path / "a.csv", titles), ARM)


@pytest.mark.parametrize(
    "form", ["2024-05-01 10:00:{:09.6f}", "2024-05-01T10:00:{:09.6f}Z", "2024/05/01 12:00:{:09.6f}+02:00"]
)
def test_dates_are_converted_to_seconds_since_the_first_sample(tmp_path, form):
    log = read_log(write(tmp_path / "a.csv", PLAIN, times=[form.format(t) for t in T]), ARM)
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    assert "dates" in log.notes[0]


def test_unix_times_are_read_with_microsecond_accuracy(tmp_path):
    log = read_log(write(tmp_path / "a.csv", PLAIN, times=[f"{1_700_000_000 + t:.6f}" for t in T]), ARM)
    np.testing.assert_allclose(log.t, T, atol=5e-7)


def test_velocities_can_be_left_out(tmp_path):
    titles = ["time", *PLAIN[1:4], *numbered("dq", "{word}_{k}"), *PLAIN[4:]]
    path = write(tmp_path / "a.csv", titles, np.column_stack([T, Q, DQ, TAU]))
    np.testing.assert_allclose(read_log(path, ARM).dq, DQ)
    log = read_log(path, ARM, drop=["dq"])
    assert log.dq is None and log.notes == ("`dq` is left out, as `drop` says",)
    assert read_log(path, ARM, drop=["dq_2"]).dq is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"drop": ["q"]}, "which identification needs"),
        ({"drop": ["elbow"]}, "a joint of the arm"),
        ({"drop": ["gripper"]}, "no column or joint of `a.csv`"),
        ({"columns": {"ddq": "x"}}, "the quantities are `t`, `q`, `dq` and `tau`"),
        ({"columns": {"q": ["q_1"]}}, "names 1 columns for `q`"),
        ({"columns": {"tau": "torque"}}, "no column `torque` for joint"),
        ({"columns": {"t": "when"}}, "no column `when` for `t`"),
        ({"topic": "/x"}, "has no topics"),
    ],
)
def test_option_that_does_not_fit_the_log_is_refused(tmp_path, options, words):
    with pytest.raises(DefinitionError, match=words):
        read_log(write(tmp_path / "a.csv", PLAIN), ARM, **options)


@pytest.mark.parametrize("text", ["position", "q=", "=x", "q=a,,b"])
def test_column_options_of_another_form_are_refused(text):
    with pytest.raises(DefinitionError, match="needs the form QUANTITY=COLUMN"):
        parse_columns([text])


def with_entry(text):
    return lambda line: ",".join([*line.split(",")[:5], text, *line.split(",")[6:]])


@pytest.mark.parametrize(
    ("row", "damage", "words"),
    [
        (7, with_entry(""), "line 8: column `tau_2` is empty"),
        (7, with_entry("n/a"), "line 8: `n/a` in column `tau_2`"),
        (7, with_entry("1_5"), "line 8: `1_5` in column `tau_2`"),
        (7, lambda line: line.rpartition(",")[0], "line 8: 6 entries, but line 1 names 7 columns"),
        (7, lambda line: line + ",1", "line 8: 8 entries, but line 1 names 7 columns"),
        (-1, lambda line: line[:9], "delete this line if writing it was interrupted"),
        (slice(1, None), lambda lines: [], "has titles, but no rows of numbers"),
        (slice(0, 1), lambda lines: [], "line 1: numbers, but the first line must name the columns"),
        (9, lambda line: "\0" * 40, "line 10: null character"),
    ],
    ids=["hole", "word", "underscore", "short", "long", "cut", "header alone", "no header", "zeros"],
)
def test_a_malformed_table_is_refused_with_the_place_of_the_error(tmp_path, row, damage, words):
    path = write(tmp_path / "a.csv", PLAIN)
    lines = path.read_text().splitlines()
    lines[row] = damage(lines[row])
    path.write_text("\n".join(lines))
    with pytest.raises(DefinitionError, match=words) as error:
        read_log(path, ARM)
    assert len(str(error.value).splitlines()) == 1


def test_empty_entries_in_an_unused_column_are_ignored(tmp_path):
    path = write(tmp_path / "a.csv", [*PLAIN, "mode"], np.column_stack([T, Q, TAU, T]))
    path.write_text("\n".join(f"{line.rpartition(',')[0]}," for line in path.read_text().splitlines()) + "\n")
    path.write_text(path.read_text().replace("tau_3,", "tau_3,mode", 1))
    assert_read(read_log(path, ARM))


def test_a_decimal_point_in_a_table_with_decimal_commas_is_refused(tmp_path):
    path = write(tmp_path / "a.csv", PLAIN, separator=";", comma=True)
    lines = path.read_text().splitlines()
    lines[200] = ";".join([*lines[200].split(";")[:-1], "1.234"])
    path.write_text("\n".join(lines))
    with pytest.raises(DefinitionError, match=r"line 201, column `tau_3`: `1.234` has a point"):
        read_log(path, ARM)


def test_lines_of_separators_alone_are_left_out(tmp_path):
    path = write(tmp_path / "a.csv", PLAIN)
    path.write_text(path.read_text() + "\n,,,,,,\n;;\n")
    assert_read(read_log(path, ARM))


def test_decimal_commas_with_comma_separators_are_refused_with_the_remedy(tmp_path):
    path = write(tmp_path / "a.csv", PLAIN, np.column_stack([T + 0.1, Q + 0.123, TAU + 0.123]), comma=True)
    with pytest.raises(DefinitionError, match="if the decimal sign is a comma, separate the columns by semi"):
        read_log(path, ARM)


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


def test_numeric_parquet_types_are_converted_and_others_refused(tmp_path):
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


def test_name_list_in_parquet_assigns_values_to_joints(tmp_path):
    names, places = ["wrist", "finger", "shoulder", "elbow"], [2, 0, 0, 1]
    columns = {"time": T, "position": Q[:, places].tolist(), "effort": TAU[:, places].tolist()}
    pq.write_table(pa.table({**columns, "name": [names] * K}), tmp_path / "a.parquet")
    log = read_log(tmp_path / "a.parquet", ARM)
    assert_read(log)
    assert log.notes == ("the arm has no joint `finger`: left out",)
    pq.write_table(pa.table({**columns, "name": [names] * (K - 1) + [names[::-1]]}), tmp_path / "a.parquet")
    with pytest.raises(DefinitionError, match="names in column `name` differ from row to row"):
        read_log(tmp_path / "a.parquet", ARM)


def test_parquet_lists_are_read_as_joint_vectors(tmp_path):
    pq.write_table(pa.table({"time": T, "position": Q.tolist(), "effort": TAU.tolist()}), tmp_path / "a.parquet")
    assert_read(read_log(tmp_path / "a.parquet", ARM))


CONVENTIONS = Conventions()
KINDS = ("rad", "m", "rad")


@pytest.mark.parametrize(
    ("titles", "message"),
    [
        (
            ["q_1 [mm]", "q_2 [mm]", "q_3 [deg]"],
            r"column `q_1 \[mm\]` does not fit joint `shoulder`, which is revolute",
        ),
        (
            ["q_1 [rad]", "q_2 [deg]", "q_3 [deg]"],
            r"column `q_2 \[deg\]` does not fit joint `elbow`, which is prismatic",
        ),
        (["q_1", "q_2 [m]", "q_3 [m]"], r"column `q_3 \[m\]` does not fit joint `wrist`, which is revolute"),
    ],
)
def test_a_unit_in_a_title_must_fit_the_kind_of_joint(tmp_path, titles, message):
    log = read_log(write(tmp_path / "a.csv", ["time", *titles, *numbered("tau", "{word}_{k}")]), ARM)
    with pytest.raises(DefinitionError, match=message):
        CONVENTIONS.applied(log, KINDS)


def test_a_velocity_in_a_title_must_fit_the_kind_of_joint(tmp_path):
    titles = ["time", *numbered("q", "{word}_{k}"), "dq_1 [rad/s]", "dq_2 [rpm]", "dq_3 [rpm]"]
    values = np.column_stack([T, Q, DQ, TAU])
    log = read_log(write(tmp_path / "a.csv", [*titles, *numbered("tau", "{word}_{k}")], values), ARM)
    with pytest.raises(DefinitionError, match=r"`dq_2 \[rpm\]` does not fit joint `elbow`"):
        CONVENTIONS.applied(log, KINDS)


def test_units_in_titles_follow_the_joint_order_of_the_log(tmp_path):
    titles = ["time", "q_1 [mm]", "q_2 [rad]", "q_3 [deg]", *numbered("tau", "{word}_{k}")]
    log = read_log(write(tmp_path / "a.csv", titles), ARM)
    swapped = Conventions(joint_order=["elbow", "shoulder", "wrist"]).applied(log, KINDS)
    np.testing.assert_allclose(swapped.q[:, 1], 1e-3 * Q[:, 0])
    with pytest.raises(DefinitionError, match=r"`q_1 \[mm\]` does not fit joint `shoulder`"):
        CONVENTIONS.applied(log, KINDS)


def test_two_units_for_one_kind_of_joint_are_refused():
    with pytest.raises(DefinitionError, match="has 2 units for revolute joints, deg, rad: choose one of them"):
        Conventions(position_unit=["deg", "rad"])
    with pytest.raises(DefinitionError, match="has 2 units for prismatic joints, m, mm"):
        Conventions(position_unit=["rad", "m", "mm"])


def test_a_position_unit_for_a_kind_that_no_joint_has_is_refused(tmp_path):
    log = read_log(write(tmp_path / "a.csv", PLAIN), ARM)
    with pytest.raises(DefinitionError, match="`position_unit` `mm` is for prismatic joints, and the arm has none"):
        Conventions(position_unit=["mm"]).applied(log, ("rad", "rad", "rad"))
    both = Conventions(position_unit=["deg", "mm"]).applied(log, KINDS)
    np.testing.assert_allclose(both.q, Q * [np.pi / 180, 1e-3, np.pi / 180])


@pytest.mark.parametrize("unit", ["1_0", "nan", "inf", "\uff12"])
def test_a_time_unit_is_a_plain_number(unit):
    with pytest.raises(DefinitionError, match="`time_unit` must be one of"):
        Conventions(time_unit=unit)
