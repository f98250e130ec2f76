"""A recording of a run: a file that shows it."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx

from slidax._errors import DefinitionError
from slidax._writing import write_text
from slidax.simulation import Run

from .drawing import drawing
from .needed import require_packages

FRAMES_PER_SECOND = {".html": 60.0, ".mp4": 30.0, ".gif": 12.5}
"""Of each kind of file, unless asked for otherwise."""

MOST_FRAMES = {".html": 6_000, ".mp4": 60_000, ".gif": 600}
"""Of each kind of file: more would take the memory of the machine that plays it."""

CODECS = {".mp4": ("av",), ".gif": ("PIL",)}
"""The packages that write a film."""


def require_record(out: str | Path) -> None:
    """Raises DefinitionError if a file can't become a recording: asked before a long run, it saves the run.

    - `out`: the file; its ending is unknown, or needs a package that is not installed.
    """
    out = Path(out)
    kind = out.suffix.lower()
    if kind not in FRAMES_PER_SECOND:
        raise DefinitionError(f"a recording ends in {', '.join(FRAMES_PER_SECOND)}; got `{out.name}`")
    if kind == ".html":
        require_packages("a page that plays a run", "viser")
    else:
        purpose = f"a film (a page needs less: `{out.with_suffix('.html').name}`)"
        require_packages(purpose, "trimesh", "mujoco", *CODECS[kind], extra="film")


def record(
    run: Run,
    plant: eqx.Module,
    out: str | Path,
    *,
    title: str = "",
    speed: float = 1.0,
    frames_per_second: float | None = None,
    beside: bool = False,
    size: tuple[int, int] = (1280, 720),
    urdf: str | Path | None = None,
    plain: bool = False,
) -> Path:
    """Writes what `show` shows to a file, and returns its path; no display is needed, and for a page no graphics.

    - `run`, `plant`, `title`, `urdf`, `plain`: as in `show`.
    - `out`: its ending says what it becomes. `.html`: one page that plays in three dimensions in any browser, also
      without a network; `.mp4` or `.gif`: a film, drawn by MuJoCo.
    - `speed`: how fast the run passes, > 0: .25 is slow motion.
    - `frames_per_second`: of the recording, > 0; 60 for a page, 30 for an .mp4, 12.5 for a .gif if not given. A page
      has 6000 frames at most, a .gif 600: a longer one has fewer per second.
    - `beside`: the reference beside the true arm, and not over it.
    - `size`: width and height of a film [px].

    Raises DefinitionError if the ending is another, the run has no log, the robot is unknown, or a package or the
    graphics for a film are missing.
    """
    out = Path(out)
    require_record(out)
    for name, value in (("speed", speed), ("frames_per_second", frames_per_second)):
        if value is not None and not 0 < value < float("inf"):
            raise DefinitionError(f"`{name}` must be > 0; got {value:g}")
    kind = out.suffix.lower()
    rate = (frames_per_second or FRAMES_PER_SECOND[kind]) / speed
    drawn = drawing(run, plant, rate=rate, most=MOST_FRAMES[kind], title=title, urdf=urdf, plain=plain)
    out.parent.mkdir(parents=True, exist_ok=True)
    if kind == ".html":
        from .page import recorded_page

        write_text(out, recorded_page(drawn, speed=speed, beside=beside))
        return out
    from .film import write_film

    write_film(drawn, out, speed=speed, beside=beside, size=size)
    return out
