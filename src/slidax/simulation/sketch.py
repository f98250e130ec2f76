"""The tracking errors of a run as a small picture, for a notebook; `slidax.figures` draws them for print."""

from __future__ import annotations

from html import escape

import numpy as np

from .run import Run

WIDTH, HEIGHT, POINTS = 640, 70, 640
"""Size of one joint's panel in pixels, and the largest number of drawn samples."""


def sketch(run: Run) -> str:
    """Each joint's error and envelope over time in a panel, as SVG; empty for a run without a log."""
    log = run.log
    if log is None or not len(log.t):
        return ""
    thin = slice(None, None, -(-len(log.t) // POINTS))
    t, e = np.asarray(log.t)[thin], np.asarray(log.e)[thin]
    bounds = None
    if log.envelope is not None:
        bounds = np.stack([np.asarray(log.envelope.lower)[thin], np.asarray(log.envelope.upper)[thin]])
    x = WIDTH * t / max(float(run.t1), 1e-300)
    panels = []
    for joint, (name, unit) in enumerate(zip(run.joint_names, run.joint_units, strict=True)):
        extremes = e[:, joint] if bounds is None else np.concatenate([e[:, joint], *bounds[..., joint]])
        size = max(float(np.abs(extremes).max()), 1e-300)

        def points(x: np.ndarray, y: np.ndarray, size: float = size) -> str:
            return " ".join(f"{a:.1f},{HEIGHT / 2 * (1 - b / size):.1f}" for a, b in zip(x, y, strict=True))

        band = ""
        if bounds is not None:
            around = points(np.append(x, x[::-1]), np.append(bounds[0, :, joint], bounds[1, ::-1, joint]))
            band = f'<polygon points="{around}" fill="#E9EEF4" stroke="#6B7785" stroke-width=".6"/>'
        line = f'<polyline points="{points(x, e[:, joint])}" fill="none" stroke="#0072B2"/>'
        label = f'<text x="{WIDTH - 4}" y="12" text-anchor="end">{escape(name)}: error up to {size:.3g} {unit}</text>'
        panels.append(f'<g transform="translate(0 {joint * (HEIGHT + 8)})">{band}{line}{label}</g>')
    height = len(panels) * (HEIGHT + 8)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'font-size="11" font-family="sans-serif">{"".join(panels)}</svg>'
    )
