"""Invalid robot files: each is refused with the name of the faulty element and without side effects."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from slidax.arms import from_mjcf, from_urdf
from slidax.core.errors import DefinitionError
from tests.arms import bad_mjcf, bad_urdf
from tests.arms.bad_file import damaged

mujoco = pytest.importorskip("mujoco")
CASES = [pytest.param(from_urdf, case, id=f"URDF: {case.title}") for case in bad_urdf.CASES] + [
    pytest.param(from_mjcf, case, id=f"MJCF: {case.title}") for case in bad_mjcf.CASES
]
GOOD = [pytest.param(from_urdf, bad_urdf.GOOD, id="URDF"), pytest.param(from_mjcf, bad_mjcf.GOOD, id="MJCF")]


@pytest.mark.parametrize(("read", "case"), CASES)
def test_invalid_files_are_errors_that_name_the_element(read, case, tmp_path, monkeypatch, capfd):
    # MuJoCo would write a log into the working directory.
    monkeypatch.chdir(tmp_path)
    source = case.source(tmp_path)
    with pytest.raises(DefinitionError) as caught:
        read(source, **case.arguments)
    message = str(caught.value)
    missing = [word for word in case.named if word not in message]
    assert not missing, message
    assert "\n" not in message
    assert not re.search(r"\bnan\b", message, re.I) or "nan" in str(case.text), "a NaN is not for the reader"
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] in ([], ["robot.xml"])


@pytest.mark.parametrize(("read", "text"), GOOD)
def test_base_file_of_the_invalid_variants_is_valid(read, text):
    assert read(text).joint_names == ("shoulder", "elbow")


@pytest.mark.parametrize(("read", "text"), GOOD)
@pytest.mark.parametrize("count", [100, pytest.param(5000, marks=pytest.mark.full)])
@pytest.mark.filterwarnings("ignore::slidax.DefinitionWarning")
def test_damaged_files_give_an_arm_or_a_definition_error(read, text, count):
    refused = []
    for seed in range(count):
        bad = damaged(text, np.random.default_rng(seed))
        try:
            arm = read(bad)
        except DefinitionError as error:
            refused.append((str(error), bad))
        else:
            numbers = (arm.masses, arm.centers, arm.inertias, arm.rotations, arm.translations)
            assert all(np.isfinite(part).all() for part in numbers), bad
    assert 0 < len(refused) < count
    shown = [message for message, bad in refused if re.search(r"\bnan\b", message, re.I) and "nan" not in bad]
    assert not shown, "a NaN is not for the reader"


@pytest.mark.parametrize(("read", "text"), GOOD)
def test_an_error_begins_with_the_path_of_the_file(read, text, tmp_path):
    path = tmp_path / "my.robot"
    path.write_text(text)
    with pytest.raises(DefinitionError, match=r"my\.robot: .*did you mean `fore`"):
        read(path, tip="for")
    with pytest.raises(DefinitionError, match=r"cannot read .*: Is a directory"):
        read(tmp_path)


@pytest.mark.parametrize(("read", "text"), GOOD)
def test_unknown_tip_or_locked_joint_is_named_with_its_nearest(read, text):
    with pytest.raises(DefinitionError, match=r"`tip` names .*`toll`.* did you mean `tool`"):
        read(text, tip="toll")
    with pytest.raises(DefinitionError, match=r"`locked` names .*`elbov`.* did you mean `elbow`"):
        read(text, locked={"elbov": 0.0})
    with pytest.raises(DefinitionError, match="joint `elbow` at 3, which is outside its limits"):
        read(text, locked={"elbow": 3.0})


@pytest.mark.parametrize(("read", "text"), GOOD)
def test_error_without_mujoco_names_the_extra_to_install(read, text, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[robots\]'"):
        read(text)


def test_warning_handler_of_mujoco_is_restored():
    def mine(message: str) -> None:
        pass

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(mine)
    try:
        from_mjcf(bad_mjcf.GOOD)
        with pytest.raises(DefinitionError):
            from_mjcf(bad_mjcf.GOOD.replace("0.0125", "x"))
        assert mujoco.get_mju_user_warning() is mine
    finally:
        mujoco.set_mju_user_warning(before)
