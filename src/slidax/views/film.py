"""A recording as a film: the arm drawn by MuJoCo without a window, the curves beside it by matplotlib."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from slidax._errors import DefinitionError

from .curves import error_curves
from .drawing import Drawing
from .studio import Studio

PANEL = 0.3
"""Share of the picture's width that the curves have."""

DOTS = 120
"""Of the curves' picture, per inch, at 720 lines."""


def write_film(drawing: Drawing, out: Path, *, speed: float, beside: bool, size: tuple[int, int]) -> None:
    """Writes the film.

    - `drawing`: what to record, all of its frames.
    - `out`: the file, `.mp4` or `.gif`.
    - `speed`: how fast the run passes.
    - `beside`: whether the reference stands beside the true arm.
    - `size`: width and height [px].

    Raises DefinitionError if this machine can't draw without a window.
    """
    t = drawing.motion.t
    rate = speed * (len(t) - 1) / float(t[-1] - t[0])
    pictures = _pictures(drawing, beside, size)
    if out.suffix.lower() == ".gif":
        _write_gif(pictures, out, rate)
    else:
        _write_mp4(pictures, out, rate)


def _pictures(drawing: Drawing, beside: bool, size: tuple[int, int]) -> Iterator[np.ndarray]:
    # Films of an odd width or height are not for every player.
    width, height = (2 * (pixels // 2) for pixels in size)
    if width < 320 or height < 240:
        raise DefinitionError(f"`size` must be at least 320 x 240; got {size[0]} x {size[1]}")
    panel = 2 * int(PANEL * width / 2)
    curves, left, right, spans = _curves(drawing, panel, height)
    with Studio(drawing, beside=beside, width=width - panel, height=height) as studio:
        for number in range(len(drawing.motion.t)):
            now = round(left + (right - left) * number / (len(drawing.motion.t) - 1))
            beside_it = curves.copy()
            for top, bottom in spans:
                beside_it[top:bottom, now : now + 2] = 30
            yield np.concatenate([studio.picture(number), beside_it], axis=1)


def _curves(drawing: Drawing, width: int, height: int) -> tuple[np.ndarray, float, float, list[tuple[int, int]]]:
    """The picture of the curves, and where in it the time starts and ends and the panels are [px]."""
    dots = DOTS * height / 720
    curves = error_curves(drawing, width / dots, height / dots)
    curves.figure.set_dpi(dots)
    canvas: Any = FigureCanvasAgg(curves.figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[:height, :width, :3]
    spans = [(round(top * height), round(bottom * height)) for top, bottom in curves.panels]
    return picture, curves.left * width, curves.right * width - 1, spans


def _write_mp4(pictures: Iterator[np.ndarray], out: Path, rate: float) -> None:
    import av

    with av.open(str(out), "w") as container:
        per_second = Fraction(rate).limit_denominator(1000)
        stream: Any = container.add_stream("libx264", rate=per_second, options={"crf": "20"})
        stream.pix_fmt = "yuv420p"
        for number, picture in enumerate(pictures):
            if number == 0:
                stream.height, stream.width = picture.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))
        container.mux(stream.encode())


def _write_gif(pictures: Iterator[np.ndarray], out: Path, rate: float) -> None:
    from PIL import Image

    none = Image.Dither.NONE
    first = Image.fromarray(next(pictures)).quantize(160, dither=none)
    images = [first, *(Image.fromarray(picture).quantize(palette=first, dither=none) for picture in pictures)]
    # The format counts in hundredths of a second.
    duration = max(2, round(100 / rate)) * 10
    first.save(out, save_all=True, append_images=images[1:], duration=duration, loop=0)
