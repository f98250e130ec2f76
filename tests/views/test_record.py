"""A recording: one file, which shows the run to whoever gets it."""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

import msgspec
import zstandard

from slidax import views
from slidax._errors import DefinitionError
from slidax.simulation import Plant, Run

from .runs import two_link

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")

LOADS = re.compile(r"""(?:\b(?:src|href|action|data)\s*=\s*|url\(|@import\s+|\bfetch\()["'(]?\s*(?:https?:)?//""")
"""What would ask a network for something."""


@pytest.fixture(scope="module")
def swing() -> tuple[Plant, Run]:
    scenario = two_link()
    return scenario.plant, scenario.simulate(progress=False)


@pytest.fixture(scope="module")
def page(swing: tuple[Plant, Run], tmp_path_factory: pytest.TempPathFactory) -> str:
    plant, run = swing
    out = views.record(
        run, plant, tmp_path_factory.mktemp("views") / "new" / "swing.html", title="a <b> & c", speed=0.5
    )
    return out.read_text(encoding="utf-8")


def recorded(page: str) -> dict[str, Any]:
    """What the player was given."""
    (data,) = re.findall(r'__VISER_EMBED_DATA__="([^"]*)"', page)
    payload = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(data)[8:])
    size = int.from_bytes(payload[:8], "little")
    result: dict[str, Any] = msgspec.msgpack.decode(payload[8 : 8 + size])
    return result


def film(page: str) -> dict[str, Any]:
    (text,) = re.findall(r"const film = (.*);", page)
    result: dict[str, Any] = json.loads(text)
    return result


def test_a_page_loads_nothing_from_a_network(page: str) -> None:
    assert LOADS.search('<script src="https://example.org/three.js">')
    assert not LOADS.search(page)
    assert page.count("</body>") == 1


def test_a_page_says_what_it_shows(page: str) -> None:
    assert "<title>a &lt;b&gt; &amp; c</title>" in page
    assert "<h1>a &lt;b&gt; &amp; c</h1>" in page
    assert "The run reached its end. Shown at 0.5 of its speed." in page
    assert page.count("<figure") == page.count("<svg ") == 2
    assert re.findall(r"<option[^>]*>([^<]*)", page) == ["joint 1", "joint 2"]


def test_a_page_plays_the_frames_of_the_run_at_its_speed(page: str, swing: tuple[Plant, Run]) -> None:
    _, run = swing
    assert run.log is not None
    film_ = film(page)
    player = recorded(page)
    assert (film_["start"], film_["end"]) == (0.0, pytest.approx(0.5))
    assert player["durationSeconds"] == pytest.approx(film_["duration"]) == pytest.approx(1.0)
    # Half the speed at 60 pictures per second: 60 after the first.
    turns = [
        (t, message["wxyz"])
        for t, message in player["messages"]
        if message["type"] == "SetOrientationMessage" and message["name"] == "/arm/2" and t > 0
    ]
    assert len(turns) == 60
    t, (w, x, y, z) = turns[-1]
    assert t == pytest.approx(1.0)
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.cos(2 * np.arctan2(z, w)) == pytest.approx(np.cos(run.log.state.q[-1].sum()), abs=1e-6)


def test_the_line_in_the_curves_goes_from_edge_to_edge_of_their_axes(page: str) -> None:
    film_ = film(page)
    assert 0 < film_["left"] < 0.3 < 0.9 < film_["right"] < 1
    tops = [top for top, _ in film_["panels"]]
    assert len(tops) == 3 and sorted(tops) == tops and all(0 <= top < end <= 1 for top, end in film_["panels"])


@pytest.mark.full
@pytest.mark.skipif(BROWSER is None, reason="no Chromium to look with")
def test_a_page_plays_in_a_browser_and_the_curves_follow(page: str, tmp_path: Path) -> None:
    out = tmp_path / "swing.html"
    out.write_text(page, encoding="utf-8")
    command = [str(BROWSER), "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--dump-dom"]
    command += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--virtual-time-budget=4000", out.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    (clock,) = re.findall(r"<output>([\d.]+) s</output>", shown)
    assert 0 < float(clock) <= 0.5
    lines = re.findall(r'<b style="top: [\d.]+%; height: [\d.]+%; left: ([\d.]+)%', shown)
    film_ = film(page)
    place = 100 * (film_["left"] + float(clock) / 0.5 * (film_["right"] - film_["left"]))
    assert [float(left) for left in lines] == [pytest.approx(place, abs=1.0)] * 6


def test_a_file_of_another_kind_is_refused(swing: tuple[Plant, Run], tmp_path: Path) -> None:
    plant, run = swing
    with pytest.raises(DefinitionError, match=r"ends in \.html, \.mp4, \.gif; got `swing\.avi`"):
        views.record(run, plant, tmp_path / "swing.avi")
    with pytest.raises(DefinitionError, match="`speed` must be > 0; got 0"):
        views.record(run, plant, tmp_path / "swing.html", speed=0.0)


def test_without_its_packages_a_film_says_what_to_install(
    swing: tuple[Plant, Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant, run = swing
    find = importlib.util.find_spec
    monkeypatch.setattr("slidax.views.needed.find_spec", lambda name: None if name == "av" else find(name))
    with pytest.raises(DefinitionError, match=r"`swing\.html`\) needs av: pip install 'slidax\[film\]'"):
        views.record(run, plant, tmp_path / "swing.mp4")


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_without_graphics_a_film_is_refused_with_the_remedy_and_leaves_no_file(
    ending: str, swing: tuple[Plant, Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    plant, run = swing

    def broken(*_: object) -> None:
        raise RuntimeError("no EGL")

    monkeypatch.setattr("slidax.views.studio._graphics", broken)
    with pytest.raises(DefinitionError, match=r"no EGL.*MUJOCO_GL.*\.html"):
        views.record(run, plant, tmp_path / f"swing{ending}", size=(320, 240), frames_per_second=10.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_shows_the_arm_and_the_passing_time(ending: str, swing: tuple[Plant, Run], tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    plant, run = swing
    out = tmp_path / f"swing{ending}"
    try:
        views.record(run, plant, out, size=(480, 270), frames_per_second=10.0)
    except DefinitionError as error:
        pytest.skip(str(error))
    pictures = decoded(out)
    assert pictures.shape[:3] == (6, 270, 480)
    scene = pictures[:, :, :336].astype(int)
    # The arm moves, and its reference is orange.
    assert np.abs(scene[0] - scene[-1]).max(axis=2).astype(bool).mean() > 0.005
    assert ((scene[0, ..., 0] > scene[0, ..., 2] + 60) & (scene[0, ..., 0] > 120)).mean() > 0.002
    # The dark line in the curves moves to the right.
    curves = pictures[:, 60:100, 336:].mean(axis=3)
    places = [int(np.argmin(picture.mean(axis=0))) for picture in curves[1:]]
    assert places == sorted(places) and places[0] < places[-1]


def decoded(path: Path) -> np.ndarray:
    if path.suffix == ".gif":
        from PIL import Image, ImageSequence

        with Image.open(path) as film_:
            assert film_.info["duration"] == 100
            return np.stack([np.array(frame.convert("RGB")) for frame in ImageSequence.Iterator(film_)])
    import av

    with av.open(str(path)) as container:
        assert container.streams.video[0].average_rate == 10
        return np.stack([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])
