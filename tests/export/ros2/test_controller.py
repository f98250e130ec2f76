import json
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export.ros2 import RATE_TOLERANCE, as_list, as_text, export_ros2, interface_names, update_rate
from tests.export.exported import needs_a_compiler, needs_cmake

STUBS = Path(__file__).parent / "stubs"
PACKAGE = "slidax_law_controller"
TYPES = {
    "double": "double",
    "int": "long",
    "bool": "bool",
    "string": "std::string",
    "double_array": "std::vector<double>",
    "string_array": "std::vector<std::string>",
}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros2")
    scenario = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}})
    export_ros2(scenario, folder, name="law", golden=False)
    return folder


def parameters_of(package):
    return YAML(typ="safe").load((package / "src" / "parameters.yaml").read_text())


@pytest.fixture(scope="module")
def parameters(package):
    return parameters_of(package)


def leaves(tree, path=""):
    for name, value in tree.items():
        if "type" in value and isinstance(value["type"], str):
            yield path + name, value
        else:
            yield from leaves(value, f"{path}{name}.")


def header(tree):

    def written(value):
        if isinstance(value, list):
            return "{" + ", ".join(map(written, value)) + "}"
        if isinstance(value, bool):
            return str(value).lower()
        return f'"{value}"' if isinstance(value, str) else repr(value)

    def structure(inside):
        lines = []
        for name, value in inside.items():
            if "type" in value and isinstance(value["type"], str):
                lines.append(f"{TYPES[value['type']]} {name} = {written(value['default_value'])};")
            else:
                lines.append(f"struct {{ {structure(value)} }} {name};")
        return "\n".join(lines)

    ((namespace, inside),) = tree.items()
    return f"""
        #include <memory>
        #include <string>
        #include <vector>
        namespace {namespace} {{
        struct Params {{ {structure(inside)} }};
        inline Params parameters;
        class ParamListener {{
        public:
            template <typename Node> explicit ParamListener(const Node &) {{}}
            Params get_params() const {{ return parameters; }}
        }};
        }}
    """


def programs_of(package):
    """A function that compiles the controller with one of our programs, and returns its lines."""
    generated = package / "made" / PACKAGE
    generated.mkdir(parents=True)
    (generated / "parameters.hpp").write_text(header(parameters_of(package)))
    includes = [f"-I{path}" for path in (STUBS, package / "include", package / "made", package / "law")]
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"]
    sources = sorted((package / "law").glob("slidax_law*.c"))
    for source in sources:
        subprocess.run(["gcc", "-std=c99", "-O1", "-c", source, "-o", source.with_suffix(".o")], check=True)

    def lines_of(program):
        subprocess.run(
            ["g++", "-std=c++17", *warnings, *includes, package / "src" / "controller.cpp", STUBS / f"{program}.cpp"]
            + [source.with_suffix(".o") for source in sources]
            + ["-lm", "-o", package / program],
            check=True,
        )
        done = subprocess.run([package / program], check=True, capture_output=True, text=True)
        (package / f"{program}.txt").write_text(done.stdout)
        return done.stdout.splitlines()

    return lines_of


@pytest.fixture(scope="module")
def run(package):
    return programs_of(package)


@needs_a_compiler
@needs_cmake
def test_the_controller_follows_the_ros2_control_life_cycle(run):
    message = run("main")
    lines = iter(message)
    assert next(lines) == "init 1" and next(lines) == "interfaces 2 4"
    assert next(lines).startswith("wrong rate 1 the law needs 1000 Hz") and next(lines) == "configure 1"
    assert next(lines) == "an interface is missing 1"
    assert next(lines) == "no value 1 not begun: a joint has no position or velocity yet"
    assert next(lines) == "no posture 1 not begun: the measured posture is not finite (joint 1)"
    assert next(lines) == "activate 1"
    for what, most in (("hold", 0.02), ("trajectory", 0.1), ("there", 0.02)):
        name, number = next(lines).split()
        assert name == what and 0.0 <= float(number) < most, message
    assert next(lines).startswith("finger: trajectory joint `finger` is ignored")
    assert next(lines) == "wrong name: trajectory rejected: it must have the joint `joint_2` once"
    assert next(lines).startswith("not finite: trajectory rejected: a number is NaN or infinite; joint `joint_1`")
    assert next(lines) == "stopped after 6"
    assert next(lines) == "finite 1"
    assert next(lines).startswith("deactivate 1 stopped: no good measurement for too long")
    assert list(lines) == ["again 1", "error 1", "configure again 1", "cleanup 1", "shutdown 1"]


@pytest.fixture(scope="module")
def action(run):
    return dict(line.split(": ", 1) for line in run("action"))


@needs_a_compiler
@needs_cmake
def test_goals_succeed_or_are_refused_and_no_goal_is_lost(action):
    assert action["name"] == "law/follow_joint_trajectory" and action["inactive"] == "1"
    succeeded, refused = int(action["succeeded"]), int(action["refused"])
    assert succeeded + refused == 200 and min(succeeded, refused) >= 20
    assert {action[name] for name in ("wrong", "wrong then", "wrong at last")} == {"0"}


@needs_a_compiler
@needs_cmake
def test_a_new_goal_preempts_the_current_goal_and_every_cancel_succeeds(action):
    assert int(action["preempted"]) >= 50 and int(action["slowed"]) >= 5
    canceled, requests = map(int, action["canceled"].split(" of "))
    assert canceled == requests >= 50


@needs_a_compiler
@needs_cmake
@pytest.mark.parametrize(
    ("goal", "result"),
    [
        ("wrong joint", r"aborted -2 it must have the joint `joint_\d` once"),
        ("not finite", "aborted -1 a number is NaN or infinite; joint `joint_2`.*"),
        ("tolerance of nobody", "aborted -2 a tolerance names the joint `finger`, which the law does not have"),
        ("starts elsewhere", "aborted -1 its first point is not where the arm is; joint `joint_1`: 0.4 .*allowed 0.1"),
        ("too strong", r"aborted -1 it needs more torque than a trajectory may; joint `joint_\d`: .* allowed 42"),
        ("slowed down", "succeeded 0 slowed down by a factor of .*"),
        ("path tolerance", "aborted -4 path tolerance violated; joint `joint_2`: .*allowed 1e-07"),
        ("goal tolerance, waiting", "executing 99 "),
        ("goal tolerance", "aborted -5 goal tolerance violated; joint `joint_1`: .*allowed 1e-13"),
        ("topic", "aborted -1 preempted by a trajectory from the topic"),
        ("deactivated", "aborted -4 the controller was deactivated"),
    ],
)
def test_a_goal_result_has_the_code_of_control_msgs_and_the_reason(action, goal, result):
    assert re.fullmatch(result, action[goal]), action[goal]


@needs_a_compiler
@needs_cmake
def test_no_goal_preemption_or_cancel_makes_the_torque_jump(action):
    assert 0.01 < float(action["jump"]) <= 1.000001 and 0.3 < float(action["torque"]) <= 1.0
    # The fastest joint of the goals moves at about 5 rad/s.
    assert float(action["reference"]) < 0.008 and float(action["lost client"]) < 0.02


def test_ros2_parameters_have_descriptions_and_validation_rules(parameters):
    result = dict(leaves(parameters[PACKAGE]))
    assert result["joints"]["default_value"] == ["joint_1", "joint_2"]
    gain = result["law.kp"]
    assert gain["validation"] and gain["description"]
    assert all(value["description"] for value in result.values())
    assert result["limits.torque"]["validation"] == {"fixed_size<>": [2]}
    assert "law.period" not in result and not any(name.startswith("law.nominal_masses") for name in result)


@pytest.mark.parametrize("name", ["left-arm/shoulder", "wam.base yaw", "\u00e9paule_1", "it's", "yes", "1"])
def test_unusual_joint_names_stay_unchanged_in_the_parameter_file(name):
    names = interface_names([name, "elbow"])
    assert names == [name, "elbow"]
    assert YAML(typ="safe").load(f"joints: {as_list(map(as_text, names))}") == {"joints": [name, "elbow"]}


@pytest.mark.parametrize("name", ['a"b', "a\\b", "a\nb"])
def test_a_joint_name_that_is_invalid_in_parameter_files_is_refused(name):
    with pytest.raises(DefinitionError, match="rename the joint in the robot's and the hardware's files"):
        interface_names([name])


def test_the_ros2_package_declares_its_plugin_dependencies_and_configuration(package):
    plugin = ElementTree.parse(package / f"{PACKAGE}.xml").getroot()
    assert plugin.get("path") == PACKAGE
    assert plugin[0].attrib == {
        "name": f"{PACKAGE}/Controller",
        "type": f"{PACKAGE}::Controller",
        "base_class_type": "controller_interface::ControllerInterface",
    }
    manifest = ElementTree.parse(package / "package.xml").getroot()
    depends = {each.text for each in manifest.findall("depend")}
    cmake = (package / "CMakeLists.txt").read_text()
    assert "controller_interface" in depends
    assert all(f"find_package({name} REQUIRED)" in cmake for name in depends)
    config = YAML(typ="safe").load((package / "config" / "controllers.yaml").read_text())
    manager = config["controller_manager"]["ros__parameters"]
    assert manager["update_rate"] == 1000 and manager["law"]["type"] == f"{PACKAGE}/Controller"
    assert config["law"]["ros__parameters"]["joints"] == ["joint_1", "joint_2"]
    assert json.loads((package / "law" / "law.json").read_text())["names"] == ["joint_1", "joint_2"]
    compile((package / "launch" / "control.launch.py").read_text(), "control.launch.py", "exec")


def test_an_unknown_gravity_compensation_is_refused(tmp_path):
    with pytest.raises(DefinitionError, match='must be "law" or "robot"'):
        export_ros2(scenarios.load("example-4.1-1khz"), tmp_path, gravity="nobody")


@pytest.mark.parametrize("period", [0.03, 0.4, 3.0])
def test_a_period_that_the_controller_would_refuse_is_refused_before_the_export(tmp_path, period):
    scenario = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}, "simulation.period": period})
    with pytest.raises(DefinitionError, match=r"set `simulation\.period` to 1/N s") as refused:
        export_ros2(scenario, tmp_path, golden=False)
    assert not list(tmp_path.iterdir())
    remedy = float(re.search(r"--set simulation\.period=([\d.e-]+)`", str(refused.value))[1])
    assert abs(update_rate(remedy) * remedy - 1.0) < 1e-7


def test_the_controller_accepts_the_rates_that_the_export_accepts(package):
    source = (package / "src" / "controller.cpp").read_text()
    assert f"static_cast<double>(law.period) - 1.0) < {RATE_TOLERANCE}))" in source
    for period in (1e-3, 0.0029, 1 / 33, 0.01):
        assert abs(update_rate(period) * period - 1.0) < RATE_TOLERANCE


def test_each_joint_of_a_scara_has_limits_in_its_own_unit(tmp_path):
    scenario = scenarios.load("example-4.2-1khz", {"scheme": {"name": "computed_torque"}})
    export_ros2(scenario, tmp_path, name="law", golden=False)
    meanings = {name: value["description"] for name, value in leaves(parameters_of(tmp_path)[PACKAGE])}
    assert meanings["limits.lower"] == "smallest positions, rad, rad, m"
    assert meanings["limits.speed"] == "largest speeds, rad/s, rad/s, m/s"
    assert meanings["limits.rate"] == "fastest change of a command, N m/s, N m/s, N/s"
    assert meanings["tolerances.goal"] == "largest errors at a goal, rad, rad, m; 0: no limit"
    pilot = (tmp_path / "law" / "slidax_law_pilot.h").read_text()
    assert "largest accelerations of a trajectory [rad/s^2, rad/s^2, m/s^2]" in pilot


def test_an_export_that_is_refused_for_a_joint_name_or_floats_writes_no_file(tmp_path, monkeypatch):
    scenario = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}})
    with pytest.raises(DefinitionError, match="only a step in doubles"):
        export_ros2(scenario, tmp_path, admission=True, single=True)
    monkeypatch.setattr(type(scenario.plant.robot), "joint_names", ("a\nb", "c"))
    with pytest.raises(DefinitionError, match="rename the joint"):
        export_ros2(scenario, tmp_path, golden=False)
    assert not list(tmp_path.iterdir())
