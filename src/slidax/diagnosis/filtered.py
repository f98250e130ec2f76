"""Signals of a log in a band of frequencies, without a shift in time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Signal = NDArray[np.floating[Any]]


def low_passed(signal: Signal, cutoff: float, period: float) -> Signal:
    """Zero-phase low-pass filter, with a cut-off of at most half of the Nyquist frequency.

    - `signal`: samples [N ...].
    - `cutoff`: the frequency [rad/s].
    - `period`: between two samples [s].
    """
    return _filtered(signal, min(cutoff, 0.5 * np.pi / period), "lowpass", period)


def band_passed(signal: Signal, band: tuple[float, float], period: float) -> Signal:
    """Zero-phase band-pass filter, limited to the frequencies that the samples resolve.

    - `signal`: samples [N ...].
    - `band`: the frequencies [rad/s].
    - `period`: between two samples [s].
    """
    return _filtered(signal, within(band, period), "bandpass", period)


def within(band: tuple[float, float], period: float) -> tuple[float, float]:
    """The part of a band that samples can show well [rad/s].

    - `band`: its two frequencies [rad/s].
    - `period`: between two samples [s].
    """
    high = min(band[1], 0.5 * np.pi / period)
    return min(band[0], 0.2 * high), high


def held(tau: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Torque at some times, held constant over each period, interpolated between two periods at a fractional time.

    - `tau`: torques [N n].
    - `times`: in periods [m].
    """
    whole = np.floor(times).astype(int)
    part = (times - whole)[:, None]
    return (1.0 - part) * tau[np.maximum(whole, 0)] + part * tau[np.clip(whole + 1, 0, len(tau) - 1)]


def _filtered(signal: Signal, edges: float | tuple[float, float], kind: str, period: float) -> Signal:
    # Here, since `slidax run` imports this room and only a run that failed is filtered.
    from scipy.signal import butter, sosfiltfilt

    sections = butter(2, edges, kind, fs=2.0 * np.pi / period, output="sos")
    return sosfiltfilt(sections, signal, axis=0)
