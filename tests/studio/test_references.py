import pytest

from slidax.core.errors import DefinitionError
from slidax.scenarios.yaml_text import read_yaml
from slidax.studio.files import Folder, OutsideError
from slidax.studio.references import require_beneath, require_file_beneath

from .tricks import tricks

MUJOCO = '<mujoco><compiler {compiler}/>{inner}<worldbody><body name="b"/></worldbody></mujoco>'


def test_no_path_trick_can_be_used_in_a_scenario(root):
    folder = Folder(root)
    refused = 0
    for name in tricks(root):
        try:
            require_beneath(folder, {"robot": {"kind": "urdf", "file": name}}, root)
        except OutsideError:
            refused += 1
        else:
            # Odd, but a name in the folder.
            assert (root / name).resolve().is_relative_to(root)
    assert refused >= 30


SHAPES = [
    *("robot: {kind: urdf, file: NAME}", "robot: {kind: identified, file: NAME}"),
    *("robot: {kind: urdf, file: own.yaml, packages: [sub, NAME]}", "trajectory: {kind: csv, file: NAME}"),
    *("uncertainty: {file: NAME}", "scenario: NAME", "uncertainty: {robot.file: {choices: [own.yaml, NAME]}}"),
    *("cases: [{robot.file: NAME}]", "one: &a {file: NAME}\ntwo: {three: *a}"),
]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["../outside/secret.yaml", "link.yaml", "folder/secret.yaml"])
def test_every_field_that_names_a_file_is_checked(root, shape, name):
    with pytest.raises(OutsideError):
        require_beneath(Folder(root), read_yaml(shape.replace("NAME", name)), root)
    require_beneath(Folder(root), read_yaml(shape.replace("NAME", "own.yaml")), root)


def test_files_named_in_referenced_files_are_checked(root):
    (root / "study.yaml").write_text("study: monte_carlo\nscenario: sub/scenario.yaml\n")
    (root / "sub/scenario.yaml").write_text("robot: {kind: identified, file: arm.yaml}\n")
    (root / "sub/arm.yaml").write_text("robot: {kind: urdf, file: ../../outside/secret.urdf}\n")
    with pytest.raises(OutsideError, match="outside"):
        require_file_beneath(Folder(root), root / "study.yaml")


@pytest.mark.parametrize(
    ("compiler", "inner"),
    [
        ("", '<include file="../outside/secret.xml"/>'),
        ("", '<include file="folder/secret.xml"/>'),
        ("", '<include file="sub/second.xml"/>'),
        ('meshdir="../outside"', '<asset><mesh name="m" file="secret.xml"/></asset>'),
        ('meshdir="folder"', '<asset><mesh name="m" file="secret.xml"/></asset>'),
        ("", '<asset><mesh name="m" file="/etc/passwd"/></asset>'),
        ('texturedir="sub/up"', '<asset><texture file="outside/secret.xml"/></asset>'),
        ("", '<asset><hfield name="h" file="file:///etc/passwd"/></asset>'),
        ("", '<asset><model name="m" file="../outside/secret.xml"/></asset>'),
        ("", '<asset><texture fileup="../outside/secret.xml"/></asset>'),
    ],
)
def test_files_that_mujoco_would_open_are_checked(root, compiler, inner):
    (root / "arm.xml").write_text(MUJOCO.format(compiler=compiler, inner=inner))
    (root / "sub/second.xml").write_text(MUJOCO.format(compiler="", inner='<include file="../../outside/secret.xml"/>'))
    with pytest.raises(OutsideError):
        require_beneath(Folder(root), {"robot": {"kind": "mjcf", "file": "arm.xml"}}, root)


def test_an_mjcf_file_with_xml_entities_is_refused(root):
    (root / "arm.xml").write_text(
        '<!DOCTYPE m [<!ENTITY s SYSTEM "../outside/secret.xml">]><mujoco>&s;<worldbody/></mujoco>'
    )
    with pytest.raises(DefinitionError, match="DOCTYPE"):
        require_beneath(Folder(root), {"robot": {"kind": "mjcf", "file": "arm.xml"}}, root)


def test_meshes_outside_the_folder_are_ignored_unless_they_are_read(root):
    mesh = '<robot name="r"><link name="l"><visual><geometry><mesh filename="NAME"/></geometry></visual></link></robot>'
    (root / "arm.urdf").write_text(mesh.replace("NAME", "file:///etc/passwd"))
    scenario = {"robot": {"kind": "urdf", "file": "arm.urdf"}}
    require_beneath(Folder(root), scenario, root)
    with pytest.raises(OutsideError):
        require_beneath(Folder(root), {"robot": scenario["robot"] | {"meshes": True}}, root)


def test_circular_references_between_files_cause_no_endless_loop(root):
    (root / "a.yaml").write_text("robot: {kind: identified, file: b.yaml}")
    (root / "b.yaml").write_text("robot: {kind: identified, file: a.yaml}")
    require_file_beneath(Folder(root), root / "a.yaml")


@pytest.mark.parametrize("data", [{"robot": {"kind": "urdf", "file": "arm.xacro"}}, {"robot": "arm.urdf.xacro"}])
def test_a_xacro_file_is_refused_with_the_command_that_expands_it(tmp_path, data):
    (tmp_path / "arm.xacro").write_text("<robot/>")
    with pytest.raises(DefinitionError, match="does not expand: run `xacro FILE"):
        require_beneath(Folder(tmp_path), data, tmp_path)
