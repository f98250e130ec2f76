import os
import signal
import sys

import pytest

import slidax as sx
from slidax import DefinitionError

from .readers import BUILT_IN, all_readers, example

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="has no such files")

# A bag can be read without its metadata, and a mesh is named in a warning.
READERS = [reader for reader in all_readers() if reader.name != "bag metadata" and "mesh" not in reader.name]


@pytest.fixture(autouse=True)
def _limit_of_time():
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("the reader waits"))
    signal.alarm(20)
    yield
    signal.alarm(0)


def place(tmp_path, reader):
    path = tmp_path / reader.file
    path.parent.mkdir(parents=True, exist_ok=True)
    reader.prepare(path.parent)
    path.unlink(missing_ok=True)
    return path


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name.replace(" ", "-"))
@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_a_pipe_a_device_or_a_huge_file_is_refused(tmp_path, reader, kind):
    path = place(tmp_path, reader)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            # A hole, which takes no room on the disk.
            file.truncate(20 * 10**9)
    with pytest.raises(DefinitionError) as error:
        reader.read(path)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("named", ["/dev/zero", "pipe.csv"])
def test_scenario_does_not_read_a_device_as_its_motion(tmp_path, named):
    os.mkfifo(tmp_path / "pipe.csv")
    text = (BUILT_IN / "example-4.1.yaml").read_text(encoding="utf-8")
    with pytest.raises(DefinitionError, match="only regular files are read"):
        sx.scenarios.parse(text, {"trajectory": {"kind": "csv", "file": str(tmp_path / named)}}).build("x")


@pytest.mark.parametrize(
    "part",
    [
        '<include file="pipe.xml"/>',
        '<asset><mesh name="m" file="pipe.xml"/></asset>',
        '<asset><model name="m" file="pipe.xml"/></asset>',
    ],
)
def test_an_mjcf_file_that_names_a_pipe_is_refused_without_waiting(tmp_path, part):
    pytest.importorskip("mujoco")
    os.mkfifo(tmp_path / "pipe.xml")
    text = example("robots/two_link.xml")().decode()
    path = tmp_path / "a.xml"
    path.write_text(text.replace("<worldbody>", f"{part}<worldbody>", 1), encoding="utf-8")
    with pytest.raises(DefinitionError, match="only regular files are read"):
        sx.arms.from_mjcf(path)


def test_mesh_that_is_a_pipe_is_not_opened(tmp_path):
    meshes = pytest.importorskip("slidax.report.replay.shapes")
    from slidax.arms.files import Shape

    os.mkfifo(tmp_path / "m.stl")
    shape = Shape("a", "mesh", None, None, None, "m.stl", tmp_path / "m.stl")
    with pytest.raises(DefinitionError, match="cannot read the mesh"):
        meshes._meshes(shape)
