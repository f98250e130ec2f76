"""A recording as one page, which plays in three dimensions in any browser, without a network."""

from __future__ import annotations

import contextlib
import html
import io

import viser
from markupsafe import Markup

from slidax.figures.svg import inline, to_svg
from slidax.reports.page import render

from .curves import joint_curves
from .drawing import Drawing
from .scene import Scene
from .solid import ACTUAL, DESIRED, Colour

WIDTH = 400
"""Of the panel beside the arm [px]."""


def recorded_page(drawing: Drawing, *, speed: float, beside: bool) -> str:
    """The text of the page: viser's own player with the scene in it, and beside it the curves of each joint.

    - `drawing`: what to record, all of its frames.
    - `speed`: how fast the run passes.
    - `beside`: whether the reference stands beside the true arm.
    """
    t = drawing.motion.t
    duration = float(t[-1] - t[0]) / speed
    page = _player(drawing, duration, beside)
    curves = [joint_curves(drawing, joint) for joint in range(drawing.skeleton.joints)]
    places = {"left": curves[0].left, "right": curves[0].right, "panels": curves[0].panels}
    values = {
        "title": drawing.title or "Replay",
        "outcome": drawing.run.outcome.message,
        "speed": speed,
        "names": drawing.skeleton.names,
        "pictures": [Markup(inline(to_svg(each.figure, f"j{number}"))) for number, each in enumerate(curves)],
        "film": {"start": float(t[0]), "end": float(t[-1]), "duration": duration, **places},
        "actual": _hexadecimal(ACTUAL),
        "desired": _hexadecimal(DESIRED),
        "width": WIDTH,
    }
    panel = render("panel.html.j2", values, packages=("slidax.views",))
    end = page.rindex("</body>")
    titled = page[:end].replace("<title>Viser</title>", f"<title>{html.escape(drawing.title or 'Replay')}</title>", 1)
    return titled + panel + page[end:]


def _player(drawing: Drawing, duration: float, beside: bool) -> str:
    """The recorder of viser keeps what a server sends, so there has to be one for as long as that takes."""
    frames = len(drawing.motion.t)
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            scene = Scene(server, drawing, beside=beside)
            recorder = server.get_scene_serializer()
            for number in range(1, frames):
                recorder.insert_sleep(duration / (frames - 1))
                scene.frame(number)
            return recorder.as_html()
        finally:
            server.stop()


def _hexadecimal(colour: Colour) -> str:
    return "#" + bytes(colour).hex()
