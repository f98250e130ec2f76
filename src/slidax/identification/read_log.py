"""A log from a file: CSV, Parquet, or messages of ROS, as JSON, in an MCAP file or in a folder of ros2 bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from slidax._errors import DefinitionError
from slidax.logs import read_bag, read_joint_states

from .csv_log import read_csv
from .joint_states import log_of_messages, read_json
from .log import Log
from .parquet_log import read_parquet
from .reading import Reading


def read_log(
    path: str | Path,
    joints: Sequence[str],
    *,
    topic: str | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    drop: Sequence[str] = (),
) -> Log:
    """Return the log in a file, by its ending.

        log = read_log("bag.mcap", arm.joint_names, topic="/robot1/joint_states", drop=["dq"])

    Joints are found by their names wherever the log has names. The log's `notes` say what was left out or converted.

    - `path`: `.csv` (also `.tsv`, `.txt`) with a line that names the columns; `.parquet`, as `slidax run --out` writes
      it; `.json` or `.jsonl` with `sensor_msgs/JointState` messages, in a list or one a line; `.mcap` with such
      messages of ROS 2, as `slidax run`, `slidax loop` and `ros2 bag` write them; a folder of `ros2 bag`, or
      its `.db3`.
    - `joints`: the arm's joints, in its order.
    - `topic`: of the messages, where a log has several with joint states.
    - `columns`: for `t`, `q`, `dq` or `tau`, the word that its columns have in their titles, or a title per joint.
    - `drop`: quantities (`dq`), columns, joints by name, or joints by their number in the log, that are left out.

    Raises DefinitionError if it cannot be read, has another ending, or lacks something.
    """
    path = Path(path)
    reading = Reading(topic, dict(columns or {}), tuple(drop))
    reader = _from_bag if path.is_dir() else READERS.get(path.suffix.lower())
    if reader is None:
        raise DefinitionError(
            f"cannot read `{path.name}`: a log ends in {', '.join(READERS)}, or is a folder of ros2 bag"
        )
    if topic is not None and reader not in (_from_mcap, _from_bag):
        raise DefinitionError(f"`{path.name}` has no topics: leave `topic` out")
    return reader(path, joints, reading)


def _from_mcap(path: Path, joints: Sequence[str], reading: Reading) -> Log:
    states = read_joint_states(path, reading.topic, joints)
    return log_of_messages(f"`{path.name}`", joints, states.messages, reading, states.notes)


def _from_bag(path: Path, joints: Sequence[str], reading: Reading) -> Log:
    states = read_bag(path, reading.topic, joints)
    return log_of_messages(f"`{path.name}`", joints, states.messages, reading, states.notes)


READERS: dict[str, Callable[[Path, Sequence[str], Reading], Log]] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".json": read_json,
    ".jsonl": read_json,
    ".mcap": _from_mcap,
    ".db3": _from_bag,
}
