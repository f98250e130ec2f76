import re
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    (built,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])
    return Path(built)


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    place = tmp_path_factory.mktemp("sdist")
    (built,) = SdistBuilder(str(ROOT)).build(directory=str(place))
    with tarfile.open(built) as archive:
        archive.extractall(place, filter="data")
    (folder,) = (path for path in place.iterdir() if path.is_dir())
    return folder


def own(folder):
    left = {"__pycache__", ".DS_Store"}
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and not left & set(path.parts)
    }


def test_the_wheel_has_exactly_the_files_of_the_package(wheel):
    expected = {f"slidax/{name}" for name in own(ROOT / "src" / "slidax")}
    with zipfile.ZipFile(wheel) as archive:
        result = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert {"slidax/py.typed", "slidax/arms/built_in_arms/panda.yaml", "slidax/report/templates/page.css"} <= result
    assert result == expected


def test_the_wheel_is_for_every_system(wheel):
    assert wheel.name == f"slidax-{PROJECT['version']}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        assert not [name for name in archive.namelist() if name.endswith((".so", ".pyd", ".dylib", ".dll"))]
        assert "Requires-Python: >=3.11" in archive.read(metadata).decode()


def test_the_sdist_builds_the_same_wheel(wheel, unpacked, tmp_path):
    (again,) = WheelBuilder(str(unpacked)).build(directory=str(tmp_path), versions=["standard"])
    assert Path(again).read_bytes() == wheel.read_bytes()


@pytest.mark.parametrize("folder", ["src", "tests", "docs", "examples", "benchmarks", "scripts", "requirements"])
def test_the_sdist_has_every_file_of_its_folders(unpacked, folder):
    missing = {name for name in own(ROOT / folder) - own(unpacked / folder) if not name.startswith("api/")}
    assert not missing


def test_the_sdist_has_every_file_that_its_readme_links_to(unpacked):
    text = (unpacked / "README.md").read_text(encoding="utf-8")
    links = set(re.findall(r"\]\((?!http)([^)#]+)", text))
    assert len(links) > 10 and {link for link in links if not (unpacked / link).exists()} == set()


def test_extra_all_has_every_extra_except_cuda():
    named = [extra for line in EXTRAS["all"] for extra in line.split("]")[0].removeprefix("slidax[").split(",")]
    assert sorted(named) == sorted(set(EXTRAS) - {"all", "cuda"})


def test_every_install_hint_names_an_existing_extra():
    named = set()
    for path in [*(ROOT / "src").rglob("*.py"), *(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]:
        for listed in re.findall(r"slidax\[([\w,-]+)\]", path.read_text(encoding="utf-8")):
            named |= set(listed.split(","))
    assert {"native", "robots", "view"} <= named and named <= set(EXTRAS)


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("src/slidax/__init__.py", r'^__version__ = "(.+)"$'),
        ("CITATION.cff", r"^version: (.+)$"),
        ("CHANGELOG.md", r"^## \[(\d[^\]]*)\]"),
    ],
)
def test_the_version_is_the_same_in_package_citation_and_changelog(name, pattern):
    result = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert result and result[1] == PROJECT["version"]


def test_the_container_context_has_all_needed_files():
    ignored = (ROOT / ".containerignore").read_text(encoding="utf-8")
    assert ignored == (ROOT / ".dockerignore").read_text(encoding="utf-8")
    visible = {line[1:] for line in ignored.splitlines() if line.startswith("!")}
    assert all((ROOT / name).exists() for name in visible)
    needed = {
        "src",
        "pyproject.toml",
        PROJECT["readme"],
        *PROJECT["license-files"],
        "requirements",
        "scripts/hashed-requirements",
    }
    assert visible == needed
