"""A recorded replay of a run: one HTML file that plays in any browser, without Python and without a network."""

from __future__ import annotations

import contextlib
import html
import io
from pathlib import Path

import equinox as eqx

from slidax._errors import DefinitionError
from slidax._writing import write_text
from slidax.simulation import Run

from .drawing import Drawing, draw
from .needed import require_packages

RECORDED_FRAMES = 6_000
"""Frames of a recording at most: more would exceed the memory of the browser."""


def require_record(out: str | Path) -> None:
    """Raise DefinitionError if `out` does not end in .html, or viser is not installed.

    Called before a long run, so that its result is not lost.
    """
    if Path(out).suffix.lower() != ".html":
        raise DefinitionError(f"a recording must end in .html; got `{Path(out).name}`")
    require_packages("a recorded replay", "viser")


def record(
    run: Run,
    plant: eqx.Module,
    out: str | Path,
    *,
    title: str = "",
    speed: float = 1.0,
    frames_per_second: float = 60.0,
    beside: bool = False,
    urdf: str | Path | None = None,
    plain: bool = False,
) -> Path:
    """Write the scene of `show` as one HTML file with viser's player in it, and return its path.

    Neither a display nor graphics are needed.

    - `run`, `plant`, `title`, `urdf`, `plain`: as for `show`.
    - `out`: the file, NAME.html.
    - `speed`: of the replay, > 0; 0.25 is slow motion.
    - `frames_per_second`: > 0; a recording has 6000 frames at most, and a longer one fewer per second.
    - `beside`: draw the reference beside the true arm, not over it.

    Raises DefinitionError if the file has another ending, the run has no log, the robot is unknown, or a package is
    missing.
    """
    out = Path(out)
    require_record(out)
    for name, value in (("speed", speed), ("frames_per_second", frames_per_second)):
        if not 0 < value < float("inf"):
            raise DefinitionError(f"`{name}` must be > 0; got {value:g}")
    rate = frames_per_second / speed
    drawing = draw(run, plant, rate=rate, most=RECORDED_FRAMES, title=title, urdf=urdf, plain=plain)
    page = _recording(drawing, speed, beside)
    name = html.escape(drawing.title or "Replay")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, page.replace("<title>Viser</title>", f"<title>{name}</title>", 1))
    return out


def _recording(drawing: Drawing, speed: float, beside: bool) -> str:
    import viser

    from .scene import Scene

    frames, t = len(drawing.motion.t), drawing.motion.t
    # viser records what a server sends, so a server must run while the recording is made.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            scene = Scene(server, drawing, beside=beside)
            recorder = server.get_scene_serializer()
            for number in range(1, frames):
                recorder.insert_sleep(float(t[-1] - t[0]) / speed / (frames - 1))
                scene.show(number)
            return recorder.as_html()
        finally:
            server.stop()
