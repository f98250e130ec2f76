import importlib.util
import time
import urllib.error
import urllib.request
import webbrowser

import numpy as np
import pytest

pytest.importorskip("viser")

from viser import LineSegmentsHandle

from slidax.core.errors import DefinitionError
from slidax.report import replay
from slidax.report.replay.show import Player
from slidax.report.replay.solids import DESIRED


@pytest.fixture(scope="module")
def view(swing):
    plant, run = swing
    with replay.show(run, plant, title="two links", open_browser=False) as view:
        yield view


def test_the_replay_page_is_served_on_a_free_port_until_it_is_stopped(swing):
    plant, run = swing
    opened = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(webbrowser, "open", opened.append)
        view = replay.show(run, plant)
    assert opened == [view.url] and view.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(view.url, timeout=10) as answer:
        assert answer.status == 200 and b"<!doctype html>" in answer.read().lower()
    view.stop()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(view.url, timeout=10)


def test_a_replay_prints_nothing(swing, capsys):
    plant, run = swing
    replay.show(run, plant, open_browser=False).stop()
    assert capsys.readouterr().out == ""


def test_seek_moves_both_arms_to_their_poses(view):
    drawn = view._drawing
    view.seek(0.25)
    # The clock's thread draws the poses first, then sets the slider.
    patience = time.monotonic() + 30.0
    while abs(view._slider.value - 0.25) > 1e-3 and time.monotonic() < patience:
        time.sleep(0.01)
    frame = drawn.motion.frame(0.25)
    for arm, poses in ((view._scene.actual, drawn.motion.actual), (view._scene.desired, drawn.motion.desired)):
        for body, node in arm._bodies.items():
            np.testing.assert_allclose(node.position, poses.positions[frame, body], atol=1e-6)
            w, x, y, z = node.wxyz
            turned = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
            np.testing.assert_allclose(turned, poses.rotations[frame, body, :, 0], atol=1e-6)
    assert view._slider.value == pytest.approx(0.25, abs=1e-3)


def test_the_reference_is_a_ghost_over_the_arm_or_beside_it(view):
    scene, stage = view._scene, view._drawing.stage
    np.testing.assert_allclose(scene.desired.root.position, scene.actual.root.position)
    assert not scene.desired.stand.visible
    scene.place_reference(True)
    np.testing.assert_allclose(scene.desired.root.position - scene.actual.root.position, stage.shift, atol=1e-6)
    assert scene.desired.stand.visible
    scene.place_reference(False)
    meshes = view._server.scene._handle_from_node_name
    ghosts = [node for name, node in meshes.items() if name.startswith("/reference/") and name.count("/") == 3]
    assert ghosts and all((node.color, node.opacity < 0.5) == (DESIRED, True) for node in ghosts)


def test_the_paths_of_both_tips_are_thin_lines_from_start_to_end(view):
    stage, motion = view._drawing.stage, view._drawing.motion
    for name, tips in (("/arm tip", motion.actual_tip), ("/reference tip", motion.desired_tip)):
        line = view._server.scene.get_handle_by_name(name)
        assert isinstance(line, LineSegmentsHandle)
        np.testing.assert_allclose(line.points[0, 0], stage.points(tips)[0], atol=1e-6)
        np.testing.assert_allclose(line.points[-1, -1], stage.points(tips)[-1], atol=0.01)
        assert line.thickness_units == "screen"


def test_replay_charts_show_the_error_in_its_envelope_and_the_current_time(view):
    log = view._drawing.run.log
    view._chart(1)
    view._show(0.2)
    error, torque = (chart._chart for chart in view._charts)
    t, e, lower, upper, line = error.data
    assert (t[np.isfinite(line)] == 0.2).all() and np.isfinite(line).sum() == 2
    assert np.nanmin(line) < lower.min() and np.nanmax(line) > upper.max()
    for curve, logged in ((e, log.e), (lower, log.envelope.lower), (upper, log.envelope.upper)):
        np.testing.assert_allclose(curve, np.interp(t, log.t, logged[:, 1]), atol=0.02 * np.ptp(logged[:, 1]))
    assert (error.title, torque.title) == ("error [rad]", "torque [N m]")
    # This arm has no torque limits.
    assert len(torque.data) == 3 and torque.bands is None


def test_replay_time_passes_at_the_chosen_speed_and_restarts():
    shown = []
    player = Player(1.0, 2.0, shown.append)
    player.advance(0.1)
    assert shown == [1.0]
    player.advance(0.1)
    assert shown == [1.0]
    player.playing, player.speed = True, 0.5
    player.advance(0.4)
    player.advance(5.0)
    player.advance(0.1)
    assert shown[1:] == [pytest.approx(1.2), 2.0, 1.0]
    player.playing = False
    player.seek(7.0)
    player.advance(0.1)
    assert shown[-1] == 2.0 == player.time


def test_play_button_is_labelled_with_its_next_action(view):
    view.play()
    assert view._button.label == "Pause"
    view.play(False)
    assert view._button.label == "Play"
    view.seek(0.1)
    assert view.time == 0.1


def test_missing_packages_of_a_replay_are_named(swing, monkeypatch):
    plant, run = swing
    find = importlib.util.find_spec
    monkeypatch.setattr("slidax.report.replay.drawing.find_spec", lambda name: None if name == "viser" else find(name))
    with pytest.raises(DefinitionError, match=r"needs viser: pip install 'slidax\[view\]'"):
        replay.show(run, plant)
