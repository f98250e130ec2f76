"""Frequency responses of open loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import LINES, NARROW, WIDTH, legend_above, styled


@styled
def bode(frequencies: np.ndarray, loops: Mapping[str, np.ndarray], title: str = "") -> Figure:
    """Magnitude and phase of loops over the frequency, up to half of the sampling frequency.

    - `frequencies`: [k], rad/s.
    - `loops`: frequency responses [k] by name.
    - `title`: where the loops are broken open.
    """
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    size, phase = figure.subplots(2, 1, sharex=True)
    for number, response in enumerate(loops.values()):
        look = _look(number)
        size.plot(frequencies, np.abs(response), **look)
        turned = np.degrees(np.unwrap(np.angle(response)))
        # Shift by whole turns, so that the phase is near -180 degrees where the loop last has magnitude 1.
        crossed = np.flatnonzero(np.abs(response) >= 1.0)
        turned = turned - 360.0 * np.round((turned[crossed[-1] if len(crossed) else 0] + 180.0) / 360.0)
        phase.plot(frequencies, turned, **look)
    size.axhline(1.0, **NARROW)
    phase.axhline(-180.0, **NARROW)
    size.set_xscale("log")
    size.set_yscale("log")
    size.set_ylabel("|L|")
    phase.set_ylabel("phase  [degrees]")
    phase.set_xlabel("frequency  [rad/s]")
    if title:
        size.set_title(title)
    _legend(figure, loops)
    return figure


@styled
def nyquist(loops: Mapping[str, np.ndarray], disks: Mapping[str, float], title: str = "") -> Figure:
    """Loops in the complex plane, with -1 and the disk around it that the nearest loop avoids.

    - `loops`: frequency responses [k] by name.
    - `disks`: disk margins by name.
    - `title`: where the loops are broken open.
    """
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    for number, response in enumerate(loops.values()):
        axes.plot(response.real, response.imag, **_look(number))
    axes.plot(-1.0, 0.0, marker="+", color="0.1", markersize=7.0)
    least = min(disks.values(), default=0.0)
    if 0.0 < least < 2.0:
        near, far = -(2.0 - least) / (2.0 + least), -(2.0 + least) / (2.0 - least)
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.plot(0.5 * (near + far) + 0.5 * (near - far) * np.cos(turn), 0.5 * (near - far) * np.sin(turn), **NARROW)
    axes.set_xlim(-3.0, 1.5)
    axes.set_ylim(-2.25, 2.25)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("Re L")
    axes.set_ylabel("Im L")
    if title:
        axes.set_title(title)
    _legend(figure, loops)
    return figure


def _look(number: int) -> dict[str, Any]:
    """Line styles, repeated with narrower lines."""
    return {**LINES[number % len(LINES)], "linewidth": 1.1 if number < len(LINES) else 0.6}


def _legend(figure: Figure, loops: Mapping[str, np.ndarray]) -> None:
    handles = [Line2D([], [], label=name, **_look(number)) for number, name in enumerate(loops)]
    legend_above(figure, handles, columns=min(len(handles), 4))
