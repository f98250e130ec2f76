"""Folders and databases of ros2 bag."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError, plain
from slidax._files import MEGABYTE, open_file, read_text, require_file

from .joint_states import TYPES, JointStates, choose_topic, decoder
from .needed import require_rosbags
from .records import read_contents

METADATA = "metadata.yaml"
ENDINGS = (".mcap", ".db3")
MOST_BYTES = 8000 * MEGABYTE
MOST_UNPACKED, RATIO = 4000 * MEGABYTE, 30
"""Bytes that a compressed file may unpack to: at most the first number, and the second times its size."""

LONGEST_MESSAGE = MEGABYTE
"""Bytes of a joint-state message."""


def read_bag(path: Path, topic: str | None = None, joints: Sequence[str] = ()) -> JointStates:
    """Return the joint states in a folder of `ros2 bag`, or in one of its `.db3` databases.

    Reads MCAP and SQLite storage, also compressed by zstd. Without a readable `metadata.yaml`, which ros2 bag writes at
    the end of a recording, the folder's files are read in the order of their numbers.

    - `topic`, `joints`: as in `read_joint_states`.

    Raises DefinitionError if it cannot be read, has no such messages, or a package is missing.
    """
    decode = decoder()
    source = f"`{path.name}`"
    notes: list[str] = []
    bodies: dict[str, list[bytes]] = {}
    topics: set[str] = set()
    with tempfile.TemporaryDirectory(prefix="slidax-") as folder:
        for listed in _files(path, notes):
            file = _unpacked(listed, folder) if listed.suffix == ".zstd" else listed
            if file.suffix == ".mcap":
                contents = read_contents(file, TYPES)
                part, names = contents.bodies, contents.topics
                if not contents.whole:
                    notes.append(f"`{file.name}` is incomplete or damaged: it is read up to the damage")
            else:
                part, names = _states_in_database(file)
            topics |= names
            for name, messages in part.items():
                bodies.setdefault(name, []).extend(messages)
    return choose_topic(source, bodies, topics, topic, joints, decode, notes)


def _files(path: Path, notes: list[str]) -> list[Path]:
    """Files of a bag in order."""
    if not path.is_dir():
        return [path]
    listed = _listed(path)
    if listed is None:
        notes.append(f"`{path.name}` has no readable `{METADATA}`: all of its files are read")
        files = [file for file in path.iterdir() if file.name.removesuffix(".zstd").endswith(ENDINGS)]
        listed = sorted(files, key=lambda file: (_number(file), file.name))
    missing = [file.name for file in listed if len(file.name) > 255 or not file.is_file()]
    if missing:
        raise DefinitionError(f"`{path.name}` misses the file `{plain(missing[0])}`, which its `{METADATA}` names")
    if not listed:
        raise DefinitionError(
            f"`{path}` is no folder of ros2 bag: it has neither `{METADATA}` nor a file that ends in "
            f"{' or '.join(ENDINGS)}"
        )
    return listed


def _number(file: Path) -> int:
    numbers = re.findall(r"\d{1,9}", Path(file.name.removesuffix(".zstd")).stem)
    return int(numbers[-1]) if numbers else 0


def _listed(path: Path) -> list[Path] | None:
    """Files named by the metadata; None without a readable list."""
    from ruamel.yaml import YAML

    try:
        text = read_text(path / METADATA, most=MEGABYTE // 4)
        data = YAML(typ="safe", pure=True).load(text)
        names = data["rosbag2_bagfile_information"]["relative_file_paths"]
        # The name alone: a bag must not make us read outside its folder.
        files = [path / Path(name).name for name in names]
    # YAML readers raise all kinds of errors, and a bag can be read without its metadata.
    except Exception:
        return None
    return files or None


def _unpacked(file: Path, folder: str) -> Path:
    """Decompress a file into another folder."""
    import zstandard

    target = Path(folder) / file.stem
    most = min(MOST_UNPACKED, 64 * MEGABYTE + RATIO * require_file(file, most=MOST_BYTES))
    with open_file(file, most=MOST_BYTES) as packed, target.open("wb") as out:
        try:
            with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as stream:
                while part := stream.read(MEGABYTE):
                    if out.tell() > most:
                        raise DefinitionError(
                            f"`{file.name}` unpacks to more than {most / MEGABYTE:.3g} MB: unpack it by `zstd -d` first"
                        )
                    out.write(part)
        except zstandard.ZstdError as error:
            raise DefinitionError(f"`{file.name}` is damaged: {error}") from None
    return target


def _states_in_database(file: Path) -> tuple[dict[str, list[bytes]], set[str]]:
    """Raw joint states of a database by topic, and all of its topics."""
    reader = require_rosbags()
    require_file(file, most=MOST_BYTES)
    if file.suffix != ".db3":
        raise DefinitionError(f"`{plain(file.name)}` has an unknown storage format; known: {' and '.join(ENDINGS)}")
    bodies: dict[str, list[bytes]] = {}
    try:
        with reader(file) as bag:
            topics = {connection.topic for connection in bag.connections}
            wanted = [connection for connection in bag.connections if connection.msgtype in TYPES]
            for connection, data in _messages(bag, wanted):
                bodies.setdefault(connection.topic, []).append(data)
    except DefinitionError:
        raise
    # The database packages raise any kind of error on damaged bytes.
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"`{file.name}` is no database of ros2 bag, or damaged: {reason}") from None
    return bodies, topics


def _messages(bag: Any, wanted: Sequence[Any]) -> Iterator[tuple[Any, bytes]]:
    import zstandard

    if not wanted:
        return
    for connection, _, data in bag.messages(connections=wanted):
        if data[:4] == b"\x28\xb5\x2f\xfd":
            # Each message is compressed on its own.
            with zstandard.ZstdDecompressor(max_window_size=1 << 23).stream_reader(data) as stream:
                data = stream.read(LONGEST_MESSAGE)
        yield connection, data
