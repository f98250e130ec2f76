import base64
import re

import numpy as np
import pytest

pytest.importorskip("viser")

import msgspec
import zstandard

from slidax.core.errors import DefinitionError
from slidax.report import replay

LOADS = re.compile(r"""(?:\b(?:src|href|action|data)\s*=\s*|url\(|@import\s+|\bfetch\()["'(]?\s*(?:https?:)?//""")
"""Matches text that loads from a network."""


@pytest.fixture(scope="module")
def page(swing, tmp_path_factory):
    plant, run = swing
    out = replay.record(
        run, plant, tmp_path_factory.mktemp("views") / "new" / "swing.html", title="a <b> & c", speed=0.5
    )
    return out.read_text(encoding="utf-8")


def recorded(page):
    (data,) = re.findall(r'__VISER_EMBED_DATA__="([^"]*)"', page)
    payload = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(data)[8:])
    size = int.from_bytes(payload[:8], "little")
    result = msgspec.msgpack.decode(payload[8 : 8 + size])
    return result


def test_page_loads_nothing_from_a_network(page):
    assert LOADS.search('<script src="https://example.org/three.js">') and not LOADS.search(page)
    assert page.count("</body>") == 1


def test_page_title_is_escaped(page):
    assert "<title>a &lt;b&gt; &amp; c</title>" in page


def test_page_follows_the_colours_of_the_system_and_names_its_controls(page):
    assert '{darkMode:matchMedia("(prefers-color-scheme: dark)").matches}' in page and "{darkMode:false}" not in page
    assert page.count("<h1>a &lt;b&gt; &amp; c</h1>") == 1 and page.count('"Play or pause"') == 1


def test_page_plays_the_frames_of_the_run_at_its_speed(page, swing):
    _, run = swing
    player = recorded(page)
    assert player["durationSeconds"] == pytest.approx(1.0)
    # Half the speed at 60 pictures per second: 60 after the first.
    turns = [
        (t, message["wxyz"])
        for t, message in player["messages"]
        if message["type"] == "SetOrientationMessage" and message["name"] == "/arm/2" and t > 0
    ]
    assert len(turns) == 60
    t, (w, x, y, z) = turns[-1]
    assert t == pytest.approx(1.0) and (x, y) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.cos(2 * np.arctan2(z, w)) == pytest.approx(np.cos(run.log.state.q[-1].sum()), abs=1e-6)


def test_unknown_file_ending_and_speed_zero_are_refused(swing, tmp_path):
    plant, run = swing
    with pytest.raises(DefinitionError, match=r"must end in \.html; got `swing\.avi`"):
        replay.record(run, plant, tmp_path / "swing.avi")
    with pytest.raises(DefinitionError, match="`speed` must be > 0 and finite; got 0"):
        replay.record(run, plant, tmp_path / "swing.html", speed=0.0)
