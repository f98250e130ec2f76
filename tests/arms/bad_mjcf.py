"""Invalid MJCF files, and files with features that an arm of rigid links cannot have."""

from __future__ import annotations

from typing import Any

from .bad_file import BadFile, changed

GOOD = """<mujoco model="arm">
  <compiler angle="degree"/>
  <option timestep="0.001"/>
  <default>
    <joint damping="0.5"/>
    <default class="strong"><joint armature="0.1" actuatorfrcrange="-50 50"/></default>
  </default>
  <worldbody>
    <body name="base">
      <body name="upper" pos="0 0 0.3">
        <joint name="shoulder" class="strong" axis="0 0 1" range="-100 120"/>
        <inertial pos="0.2 0 0.02" mass="2" fullinertia="0.02 0.03 0.04 0.001 0 0"/>
        <body name="fore" pos="0.4 0 0">
          <joint name="elbow" axis="0 1 0" range="-60 80"/>
          <inertial pos="0.1 0.01 0" mass="1.25" fullinertia="0.01 0.0125 0.015 0 0.0005 0"/>
          <site name="tool" pos="0.2 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="elbow" gear="10" ctrlrange="-2 2"/>
  </actuator>
</mujoco>
"""
"""An arm of two joints; the cases change its elbow and its forearm."""

FORE, ELBOW = '<body name="fore" pos="0.4 0 0">', '<joint name="elbow" axis="0 1 0" range="-60 80"/>'
INERTIAL = '<inertial pos="0.1 0.01 0" mass="1.25" fullinertia="0.01 0.0125 0.015 0 0.0005 0"/>'
SITE, MOTOR = '<site name="tool" pos="0.2 0 0"/>', '<motor joint="elbow" gear="10" ctrlrange="-2 2"/>'
BASE = '<body name="base">'
COMPILER, OPTION, WORLD, END = '<compiler angle="degree"/>', '<option timestep="0.001"/>', "<worldbody>", "</mujoco>"
BALL = '<geom type="sphere" size="0.05"/>'
TIED_CORD = '<equality><tendon name="tie" tendon1="cord"/></equality>'
FLEX = (
    '<flexcomp name="flag" type="grid" dim="2" count="3 3 1" spacing=".05 .05 .05" mass=".1" radius=".005">'
    '<elasticity young="1e4" poisson="0.2" thickness="1e-2" elastic2d="both"/></flexcomp>'
)
ASSET = '<asset><mesh name="hull" file="no_hull.stl"/></asset>'
LIFT = '<geom name="lift" type="mesh" mesh="hull"/>'


def case(title: str, *changes: str, named: str, **arguments: Any) -> BadFile:
    """The valid arm with parts of its text replaced."""
    return BadFile(title, changed(GOOD, *changes), tuple(named.split()), arguments)


def elbow(**attributes: str) -> str:
    """The elbow with other attributes, or further ones."""
    all_attributes = {"name": "elbow", "axis": "0 1 0", "range": "-60 80"} | attributes
    return "<joint " + " ".join(f'{key}="{value}"' for key, value in all_attributes.items()) + "/>"


def inertial(mass: str = "1.25", pos: str = "0.1 0.01 0", moments: str = "0.01 0.0125 0.015 0 0.0005 0") -> str:
    """The forearm's inertial."""
    return f'<inertial pos="{pos}" mass="{mass}" fullinertia="{moments}"/>'


def cord(attributes: str = "") -> str:
    """A tendon along both joints."""
    joints = '<joint joint="elbow" coef="1"/><joint joint="shoulder" coef="2"/>'
    return f'<tendon><fixed name="cord" {attributes}>{joints}</fixed></tendon>'


MASSES = [
    case("a moving body without mass", INERTIAL, "", named="fore mass"),
    case("a mass of 0", INERTIAL, inertial(mass="0"), named="fore mass"),
    case(
        "no inertial, and inertia is not to come from shapes",
        COMPILER,
        '<compiler inertiafromgeom="false"/>',
        INERTIAL,
        BALL,
        named="fore mass",
    ),
    case("a negative mass", INERTIAL, inertial(mass="-1"), named="fore mass"),
    case("a mass that is NaN", INERTIAL, inertial(mass="nan"), named="fore mass"),
    case("a mass that is infinite", INERTIAL, inertial(mass="inf"), named="fore mass"),
    case("a word for a mass", INERTIAL, inertial(mass="heavy"), named="fore mass"),
    case("a negative moment of inertia", INERTIAL, inertial(moments="0.01 -0.01 0.01 0 0 0"), named="fore inertia"),
    case(
        "an inertia not positive definite", INERTIAL, inertial(moments="0.01 0.01 0.01 0.02 0 0"), named="fore inertia"
    ),
    case(
        "the triangle inequality violated",
        INERTIAL,
        inertial(moments="0.01 0.01 0.1 0 0 0"),
        named="fore inertia nearest",
    ),
    case("NaN in the inertia", INERTIAL, inertial(moments="nan 0.01 0.01 0 0 0"), named="fore fullinertia"),
    case("NaN in a centre of mass", INERTIAL, inertial(pos="0 nan 0"), named="fore pos"),
    case("infinity in a centre of mass", INERTIAL, inertial(pos="0 inf 0"), named="fore"),
    case("an inertial with no inertia", INERTIAL, '<inertial pos="0 0 0" mass="1"/>', named="fore inertia"),
    case("two inertials in one body", INERTIAL, INERTIAL + INERTIAL, named="fore inertial"),
]

JOINTS = [
    case("a zero axis", ELBOW, elbow(axis="0 0 0"), named="elbow axis"),
    case("an axis that is NaN", ELBOW, elbow(axis="0 nan 0"), named="elbow axis"),
    case("an axis of two numbers", ELBOW, elbow(axis="0 1"), named="elbow axis"),
    case("lower above upper", ELBOW, elbow(range="80 -60"), named="elbow range"),
    case("limited, but no range", ELBOW, '<joint name="elbow" limited="true"/>', named="elbow range"),
    case("a range that is NaN", ELBOW, elbow(range="nan 80"), named="elbow range"),
    case("NaN in a body's place", FORE, FORE.replace("0.4", "nan"), named="fore pos"),
    case("infinity in a body's place", FORE, FORE.replace("0.4", "inf"), named="fore"),
    case("a quaternion of zeros", FORE, FORE.replace(">", ' quat="0 0 0 0">'), named="fore"),
    case("a ball joint", ELBOW, '<joint name="elbow" type="ball"/>', MOTOR, "", named="elbow ball"),
    case("a free base", BASE, BASE + '<freejoint name="loose"/>', named="loose free remove tip"),
    case(
        "a free joint at the tip",
        WORLD,
        WORLD + f'<body name="cube"><freejoint/>{BALL}</body>',
        named="cube free",
        tip="cube",
    ),
    case("a spring in a joint", ELBOW, elbow(stiffness="3"), named="elbow stiffness"),
    case("a spring with a curve", ELBOW, elbow(stiffness="0 2 0"), named="elbow stiffness"),
    case("a damping with a curve", ELBOW, elbow(damping="0.5 0.1 0"), named="elbow damping"),
    case("a negative damping", ELBOW, elbow(damping="-1"), named="elbow"),
    case("a negative friction", ELBOW, elbow(frictionloss="-1"), named="elbow"),
    case("a negative armature", ELBOW, elbow(armature="-1"), named="elbow armature"),
    case("an infinite armature", ELBOW, elbow(armature="inf"), named="elbow armature"),
    case("a torque range without 0", ELBOW, elbow(actuatorfrcrange="5 20"), named="elbow torque"),
    case("an infinite gear", MOTOR, '<motor name="drive" joint="elbow" gear="inf"/>', named="drive gear"),
    case("two joints of one name", ELBOW, elbow(name="shoulder"), MOTOR, "", named="shoulder"),
    case("two bodies of one name", FORE, FORE.replace("fore", "upper"), named="upper"),
    case("two joints about one axis", ELBOW, ELBOW + '<joint name="twin" axis="0 1 0"/>', named="elbow"),
    case("a class that does not exist", ELBOW, elbow(**{"class": "stong"}), named="elbow stong"),
    case("an attribute misspelled", ELBOW, elbow(axes="0 1 0"), named="elbow axes"),
    case(
        "no joint that moves",
        ELBOW,
        "",
        '<joint name="shoulder" class="strong" axis="0 0 1" range="-100 120"/>',
        "",
        MOTOR,
        "",
        named="joint moves",
    ),
    case("two ends and no tip", SITE, '</body><body name="fork">' + BALL, named="fore fork tip"),
]

COUPLINGS = [
    case(
        "joints coupled by an equality",
        END,
        '<equality><joint name="tie" joint1="elbow" joint2="shoulder"/></equality>' + END,
        named="tie elbow",
    ),
    case(
        "a body tied to the world",
        END,
        '<equality><connect name="tie" body1="fore" anchor="0 0 0"/></equality>' + END,
        named="tie fore",
    ),
    case(
        "a body welded to the world",
        END,
        '<equality><weld name="tie" body1="fore"/></equality>' + END,
        named="tie fore",
    ),
    case("a tendon with a spring", END, cord('stiffness="5"') + END, named="cord stiffness"),
    case("a tendon with a damper", END, cord('damping="1"') + END, named="cord damping"),
    case("a tendon with inertia", END, cord('armature="1"') + END, named="cord armature"),
    case("a tendon with friction", END, cord('frictionloss="1"') + END, named="cord frictionloss"),
    case("a tendon with a stop", END, cord('range="-1 1"') + END, named="cord range"),
    case("a tendon held at a length", END, cord() + TIED_CORD + END, named="tie cord"),
    case("a flexible body", BASE, BASE + FLEX, '<joint damping="0.5"/>', "", named="flag_"),
    case("gravity compensated", FORE, FORE.replace(">", ' gravcomp="1">'), named="fore gravcomp"),
    case("drag of the air", OPTION, '<option density="1.2" viscosity="0.00002"/>', named="density"),
    case("springs and dampers switched off", OPTION, '<option><flag damper="disable"/></option>', named="damper"),
]

TEXTS = [
    case(
        "a mesh that is not there, and inertia comes from it",
        WORLD,
        ASSET + WORLD,
        INERTIAL,
        LIFT,
        named="fore no_hull.stl",
    ),
    case(
        "a mesh that is not there",
        WORLD,
        ASSET + WORLD,
        SITE,
        SITE + LIFT,
        named="fore no_hull.stl meshes=False",
        meshes=True,
    ),
    case("a file to include that is not there", WORLD, '<include file="no_such.xml"/>' + WORLD, named="no_such.xml"),
    case("xacro left in", 'mass="1.25"', 'mass="${mass}"', named="xacro ${mass}"),
    BadFile("an empty text", "", ("empty",)),
    BadFile("a path that is not there", "no/such/robot.xml", ("no/such/robot.xml",)),
    BadFile("the text cut off", GOOD[:700], ("XML", "line")),
    BadFile("no text, but numbers", b"\x89PNG\r\n\x1a\n\x00\x00\x00", ("XML",)),
    BadFile(
        "a text in Latin-1 that does not say so", GOOD.replace("tool", "Träger").encode("latin-1"), ("XML", "line")
    ),
    BadFile("a URDF file", '<robot name="a"><link name="b"/></robot>', ("robot", "from_urdf")),
    BadFile("nothing in the world", "<mujoco/>", ("joint",)),
    BadFile("a foreign entity", '<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/hostname">]>' + GOOD, ("DOCTYPE",)),
    BadFile(
        "100 000 nested bodies",
        "<mujoco><worldbody>" + "<body>" * 100_000 + "</body>" * 100_000 + "</worldbody></mujoco>",
        ("nested",),
    ),
]

CASES = [*MASSES, *JOINTS, *COUPLINGS, *TEXTS]
