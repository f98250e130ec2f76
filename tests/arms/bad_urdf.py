"""Invalid URDF files."""

from __future__ import annotations

from typing import Any

from .bad_file import BadFile, changed

GOOD = """<?xml version="1.0" encoding="utf-8"?>
<robot name="arm">
  <link name="base"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2.5" effort="50" velocity="3"/>
    <dynamics damping="0.5" friction="0.25"/>
  </joint>
  <link name="upper">
    <inertial>
      <origin xyz="0.2 0 0.02" rpy="0.3 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.04"/>
    </inertial>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="fore"/>
    <origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1.5" effort="20" velocity="4"/>
  </joint>
  <link name="fore">
    <inertial>
      <origin xyz="0.1 0.01 0"/>
      <mass value="1.25"/>
      <inertia ixx="0.01" ixy="0" ixz="0.0005" iyy="0.0125" iyz="0" izz="0.015"/>
    </inertial>
  </link>
  <joint name="flange" type="fixed">
    <parent link="fore"/>
    <child link="tool"/>
    <origin xyz="0.2 0 0"/>
  </joint>
  <link name="tool"/>
</robot>
"""
"""An arm of two joints; the cases change its elbow and its forearm."""

ELBOW = 'name="elbow" type="revolute"'
PARENT, CHILD = '<parent link="upper"/>', '<child link="fore"/>'
ORIGIN, AXIS = '<origin xyz="0.4 0 0"/>', '<axis xyz="0 1 0"/>'
LIMIT = '<limit lower="-1" upper="1.5" effort="20" velocity="4"/>'
FORE = '<link name="fore">'
CENTER, MASS = '<origin xyz="0.1 0.01 0"/>', '<mass value="1.25"/>'
INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0.0005" iyy="0.0125" iyz="0" izz="0.015"/>'
INERTIAL = GOOD[GOOD.rindex("<inertial>") : GOOD.rindex("</inertial>") + len("</inertial>")]
TOOL = '<link name="tool"/>'
END = "</robot>"

SPARE = (
    '<link name="spare"><inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)
FLAT_TOOL = TOOL.replace("/>", ">") + (
    '<inertial><mass value="0.5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="3"/></inertial></link>'
)
ANY_LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="1"/>'
BOX = "<geometry><box size='0.1 0.1 0.1'/></geometry>"
BOMB = "<!DOCTYPE robot [<!ENTITY a 'aaaaaaaaaa'>" + "".join(
    f"<!ENTITY {new} '{(chr(38) + old + chr(59)) * 10}'>" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


def joint(kind: str, name: str, parent: str, child: str, inner: str = "") -> str:
    """A further joint."""
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'


def limit(**values: str | None) -> str:
    """The elbow's limits with some values changed or left out."""
    limits = {"lower": "-1", "upper": "1.5", "effort": "20", "velocity": "4"} | values
    return "<limit " + " ".join(f'{key}="{value}"' for key, value in limits.items() if value is not None) + "/>"


def inertia(ixx: str, iyy: str, izz: str, ixy: str = "0") -> str:
    """The forearm's inertia."""
    return f'<inertia ixx="{ixx}" ixy="{ixy}" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>'


def case(title: str, *changes: str, named: str, **arguments: Any) -> BadFile:
    """The valid arm with parts of its text replaced."""
    return BadFile(title, changed(GOOD, *changes), tuple(named.split()), arguments)


MASSES = [
    case("a moving link without mass", MASS, '<mass value="0"/>', INERTIA, inertia("0", "0", "0"), named="fore mass"),
    case("a mass, but no inertia", INERTIA, inertia("0", "0", "0"), named="fore inertia"),
    case("an inertia, but no mass", MASS, '<mass value="0"/>', named="fore mass"),
    case("a moving link without inertial", INERTIAL, "", named="fore mass"),
    case("no inertial, but a collision shape", INERTIAL, f"<collision>{BOX}</collision>", named="fore mass"),
    case("inertial misspelled", INERTIAL, INERTIAL.replace("inertial>", "inertail>"), named="fore inertail"),
    case("two inertials in one link", INERTIAL, INERTIAL + INERTIAL, named="fore inertial"),
    case("a negative mass", MASS, '<mass value="-1.25"/>', named="fore mass"),
    case("a negative moment of inertia", INERTIA, inertia("0.01", "-0.01", "0.01"), named="fore inertia"),
    case("an inertia not positive definite", INERTIA, inertia("0.01", "0.01", "0.01", "0.02"), named="fore inertia"),
    case("the triangle inequality violated", INERTIA, inertia("0.01", "0.01", "0.1"), named="fore inertia nearest"),
    case("the triangle inequality violated in a link that is fixed", TOOL, FLAT_TOOL, named="tool inertia nearest"),
    case(
        "moments of which none is positive, and the nearest body is a point",
        INERTIA,
        inertia("-0.01", "-0.01", "-0.01"),
        named="fore inertia definite",
        inertias="nearest",
    ),
    case("no mass element", MASS, "", named="fore mass"),
    case("no inertia element", INERTIA, "", named="fore inertia"),
    case("an entry of the inertia missing", INERTIA, INERTIA.replace('izz="0.015"', ""), named="fore izz"),
    case("the mass as text instead of an attribute", MASS, "<mass>1.25</mass>", named="fore mass value"),
]

NUMBERS = [
    case("a mass that is NaN", MASS, '<mass value="nan"/>', named="fore mass"),
    case("a mass that is infinite", MASS, '<mass value="inf"/>', named="fore mass"),
    case("a mass beyond all numbers", MASS, '<mass value="1e999"/>', named="fore mass"),
    case("a word for a mass", MASS, '<mass value="heavy"/>', named="fore mass heavy"),
    case("a number with a unit", MASS, '<mass value="1.25kg"/>', named="fore mass 1.25kg"),
    case("a decimal comma", MASS, '<mass value="1,25"/>', named="fore mass 1,25"),
    case("an empty number", MASS, '<mass value=""/>', named="fore mass"),
    case("a hexadecimal number", MASS, '<mass value="0x2"/>', named="fore mass 0x2"),
    case("NaN in the inertia", INERTIA, inertia("nan", "0.01", "0.01"), named="fore ixx"),
    case("NaN in a centre of mass", CENTER, '<origin xyz="0.1 nan 0"/>', named="fore xyz"),
    case("NaN in a joint's origin", ORIGIN, '<origin xyz="nan 0 0"/>', named="elbow xyz"),
    case("infinity in a joint's turn", ORIGIN, '<origin xyz="0 0 0" rpy="0 inf 0"/>', named="elbow rpy"),
    case("two numbers for a place", ORIGIN, '<origin xyz="0.4 0"/>', named="elbow xyz"),
    case("four numbers for a place", ORIGIN, '<origin xyz="0.4 0 0 0"/>', named="elbow xyz"),
    case("a word in a place", ORIGIN, '<origin xyz="0.4 zero 0"/>', named="elbow xyz"),
    case("an attribute of the origin misspelled", ORIGIN, '<origin xzy="0.4 0 0"/>', named="elbow xzy"),
    case("a negative damping", AXIS, AXIS + '<dynamics damping="-1"/>', named="elbow friction"),
    case("a negative friction", AXIS, AXIS + '<dynamics friction="-1"/>', named="elbow friction"),
    case("a damping that is NaN", AXIS, AXIS + '<dynamics damping="nan"/>', named="elbow damping"),
]

TREES = [
    case("a parent that is not there", PARENT, '<parent link="uper"/>', named="elbow uper upper"),
    case("a child that is not there", CHILD, '<child link="four"/>', named="elbow four fore"),
    case("no parent element", PARENT, "", named="elbow parent"),
    case("no child element", CHILD, "", named="elbow child"),
    case("two roots", END, SPARE + END, named="base spare"),
    case("a link with two parents", END, joint("fixed", "extra", "base", "tool") + END, named="tool flange extra"),
    case("a joint whose child is its parent", CHILD, '<child link="upper"/>', named="elbow upper"),
    case("a cycle with all links", END, joint("fixed", "extra", "tool", "base") + END, named="base tool"),
    case(
        "a cycle beside the arm",
        END,
        SPARE
        + '<link name="other"/>'
        + joint("fixed", "a", "spare", "other")
        + joint("fixed", "b", "other", "spare")
        + END,
        named="spare other",
    ),
    case("two links of one name", TOOL, TOOL + FORE + "</link>", named="fore"),
    case("two joints of one name", 'name="flange"', 'name="elbow"', named="elbow"),
    case("a link without a name", TOOL, TOOL + "<link/>", named="link name"),
    case("a joint without a name", ELBOW, 'type="revolute"', named="joint name fore"),
    case("an empty name", ELBOW, 'name="" type="revolute"', named="joint name fore"),
    case("no link", GOOD[GOOD.index("<link") : GOOD.index("</robot>")], "", named="link"),
    case("no joint", GOOD[GOOD.index("<joint") : GOOD.index("</robot>")], "", named="joint"),
    case(
        "no joint that moves",
        GOOD[GOOD.index('<joint name="elbow"') : GOOD.index("</robot>")],
        "",
        'name="shoulder" type="revolute"',
        'name="shoulder" type="fixed"',
        named="joint moves",
    ),
    case("two ends and no tip", END, SPARE + joint("fixed", "extra", "upper", "spare") + END, named="tool spare tip"),
]

JOINTS = [
    case("limits misspelled", LIMIT, LIMIT.replace("<limit", "<limits"), named="elbow limits"),
    case("lower above upper", LIMIT, limit(lower="2"), named="elbow lower upper"),
    case("a negative effort", LIMIT, limit(effort="-20"), named="elbow effort -20"),
    case("a negative velocity", LIMIT, limit(velocity="-4"), named="elbow velocity -4"),
    case("a limit that is NaN", LIMIT, limit(upper="nan"), named="elbow upper"),
    case("a velocity in words", LIMIT, limit(velocity="fast"), named="elbow velocity fast"),
    case("a zero axis", AXIS, '<axis xyz="0 0 0"/>', named="elbow axis"),
    case("an axis that is NaN", AXIS, '<axis xyz="0 nan 0"/>', named="elbow axis"),
    case("an axis without numbers", AXIS, "<axis/>", named="elbow axis xyz"),
    case("an axis misspelled", AXIS, '<axes xyz="0 1 0"/>', named="elbow axes axis"),
    case(
        "a joint that mimics one that does not exist",
        LIMIT,
        LIMIT + '<mimic joint="shoulde"/>',
        named="elbow shoulder locked",
    ),
    case("a ball joint", ELBOW, 'name="elbow" type="spherical"', named="elbow spherical"),
    case("a floating joint", ELBOW, 'name="elbow" type="floating"', named="elbow floating"),
    case("a planar joint", ELBOW, 'name="elbow" type="planar"', named="elbow planar"),
    case("a type that does not exist", ELBOW, 'name="elbow" type="hinge"', named="elbow hinge"),
    case("a type in capitals", ELBOW, 'name="elbow" type="Revolute"', named="elbow Revolute"),
    case("no type", ELBOW, 'name="elbow"', named="elbow type"),
]


def mesh(path: str) -> BadFile:
    """The valid arm with a mesh on the forearm."""
    visual = f'<visual><geometry><mesh filename="{path}"/></geometry></visual>'
    return BadFile(
        f"a mesh that is not there, {path.split('.')[-1]}",
        changed(GOOD, FORE, FORE + visual),
        ("fore", path),
        {"meshes": True},
    )


MESHES = [
    mesh("meshes/forearm.stl"),
    mesh("forearm.dae"),
    case(
        "a mesh in an unknown package",
        FORE,
        FORE + '<collision><geometry><mesh filename="package://no_such_package/fore.stl"/></geometry></collision>',
        named="fore no_such_package packages meshes=False",
        meshes=True,
    ),
    case(
        "a mesh without a file",
        FORE,
        FORE + "<visual><geometry><mesh/></geometry></visual>",
        named="fore mesh filename",
        meshes=True,
    ),
]

TEXTS = [
    case("xacro left in: a property", MASS, '<mass value="${mass}"/>', named="xacro ${mass}"),
    case(
        "xacro left in: a macro",
        '<robot name="arm">',
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">',
        TOOL,
        TOOL + '<xacro:gripper parent="tool"/>',
        named="xacro gripper",
    ),
    BadFile("an empty text", "", ("empty",)),
    BadFile("blanks only", " \n ", ("empty",)),
    BadFile("a path that is not there", "no/such/robot.urdf", ("no/such/robot.urdf",)),
    BadFile("no XML", "<robot: my arm", ("XML", "line 1")),
    BadFile("the text cut off", GOOD[:900], ("XML", "line")),
    BadFile("no text, but numbers", b"\x89PNG\r\n\x1a\n\x00\x00\x00", ("XML",)),
    BadFile("a text in Latin-1 that says UTF-8", GOOD.replace("tool", "Träger").encode("latin-1"), ("XML", "line")),
    BadFile("an encoding that does not exist", GOOD.replace("utf-8", "utf-88").encode(), ("utf-88",)),
    BadFile("two roots of the text", GOOD + "<robot/>", ("XML", "line")),
    BadFile("an SDF file", '<sdf version="1.9"><model name="a"/></sdf>', ("sdf", "robot")),
    BadFile("an MJCF file", "<mujoco><worldbody/></mujoco>", ("mujoco", "from_mjcf")),
    BadFile(
        "entities that grow without end",
        GOOD.replace('<robot name="arm">', BOMB + ']><robot name="arm">&i;'),
        ("DOCTYPE",),
    ),
    BadFile(
        "a foreign entity",
        GOOD.replace(
            '<robot name="arm">', '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;">'
        ),
        ("DOCTYPE",),
    ),
    BadFile(
        "100 000 nested elements",
        "<robot>" + "<link name='a'>" * 100_000 + "</link>" * 100_000 + "</robot>",
        ("nested",),
    ),
    BadFile(
        "a chain of 20 000 links",
        '<robot name="chain">'
        + "".join(f'<link name="l{i}"/>' for i in range(20_001))
        + "".join(joint("fixed", f"j{i}", f"l{i}", f"l{i + 1}") for i in range(20_000))
        + "</robot>",
        ("20001", "links"),
    ),
]

CASES = [*MASSES, *NUMBERS, *TREES, *JOINTS, *MESHES, *TEXTS]
