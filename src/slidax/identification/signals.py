"""From a log to smooth positions, velocities and accelerations, and the filter that all columns pass."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import signal

from slidax._errors import DefinitionError

from .log import Log
from .regressor import Motion

ORDER = 4
"""Of the Butterworth filters, which run forwards and backwards, so that nothing is delayed."""

WIDER = 4.0
"""How many times wider the positions' filter is than that of the equations: in their band it changes nothing."""

SNR = 10.0
"""The band ends where the positions' spectrum comes so near to their noise."""

NOISE_SHARE = 1e-4
"""Of an acceleration's power in the band may be noise at most: by so much it would make an inertia smaller."""

LEAST, MOST = 1.0, 30.0
"""Cut-off frequencies [Hz] within which one is chosen: beyond, drives and links are no longer rigid."""

DEGREES = 4.0 * math.pi


@dataclass(frozen=True, eq=False)
class Signals:
    """A log at even times, with what a regressor needs.

    - `t`: [k], s.
    - `motion`: smooth positions, velocities and accelerations.
    - `tau`: torques as measured [k n].
    - `cut_off`: of the filter of the equations [Hz].
    - `noise`: standard deviation of the velocities' noise [n].
    """

    t: np.ndarray
    motion: Motion
    tau: np.ndarray
    cut_off: float
    noise: np.ndarray

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return float((len(self.t) - 1) / (self.t[-1] - self.t[0]))

    @cached_property
    def _sos(self) -> np.ndarray:
        sos: np.ndarray = signal.butter(ORDER, self.cut_off, fs=self.rate, output="sos")
        return sos

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """The columns after the zero-phase filter of the equations; the same for torque and regressor.

        - `columns`: [k ...].
        """
        passed: np.ndarray = signal.sosfiltfilt(self._sos, columns, axis=0)
        return passed

    @property
    def settled(self) -> int:
        """Samples at each end within which the filter still feels the end."""
        return math.ceil(self.rate / self.cut_off)


def signals_of(log: Log, cut_off: float | None = None) -> Signals:
    """The log at even times, smoothed, with its derivatives.

    - `log`: at about even times.
    - `cut_off`: of the filter of the equations [Hz]; chosen from the positions' spectrum if not given.

    Raises DefinitionError if positions look like degrees, if given velocities are not those of the positions, or if the
    cut-off is not below a quarter of the sampling rate.
    """
    largest = float(np.abs(log.q).max())
    if largest > DEGREES:
        raise DefinitionError(f"positions of {log.source} go to {largest:.4g}: are they degrees? They must be rad or m")
    t, q, tau, dq = _even(log)
    rate = (len(t) - 1) / (t[-1] - t[0])
    found = choose_cut_off(q, rate) if cut_off is None else float(cut_off)
    if not 0 < found < rate / 4:
        raise DefinitionError(f"`cut_off` must be in (0, {rate / 4:.4g}) Hz, a quarter of the rate; got {found:g}")
    wide = signal.butter(ORDER, min(WIDER * found, 0.4 * rate), fs=rate, output="sos")
    smooth = signal.sosfiltfilt(wide, q, axis=0)
    velocity = _slope(smooth, rate)
    noise = _noise(_slope(q, rate), found, rate)
    if dq is not None:
        measured = signal.sosfiltfilt(wide, dq, axis=0)
        _require_same(log, velocity, measured)
        theirs = _noise(dq, found, rate)
        # Each joint's velocity from whichever is quieter just above the band.
        better = theirs < noise
        velocity, noise = np.where(better, measured, velocity), np.minimum(noise, theirs)
    return Signals(t, Motion(smooth, velocity, _slope(velocity, rate)), tau, found, noise)


def choose_cut_off(q: np.ndarray, rate: float) -> float:
    """The frequency [Hz] up to which the positions say more than their noise.

    The noise of encoders is even over all frequencies, so the upper part of the spectrum shows its density S. The band
    ends where a joint's spectrum falls to 10 S, or where its acceleration's noise, `S (2π)⁴ f⁵/5`, would be a
    ten-thousandth of the acceleration's power, whichever is first; the median of the joints counts.

    - `q`: positions at even times [k n].
    - `rate`: samples per second [Hz].
    """
    f, power = signal.welch(q, rate, nperseg=min(len(q), int(8 * rate)), axis=0, detrend="linear")
    floor = np.maximum(np.median(power[(f > 0.3 * rate) & (f < 0.475 * rate)], axis=0), 1e-30)
    ends = []
    for joint in range(q.shape[1]):
        above = power[:, joint] > SNR * floor[joint]
        if not above[1:4].any():
            continue  # It does not move.
        # A line spectrum has gaps: the last frequency above, within one octave of the one before it.
        seen = f[above & (f > 0)]
        gap = np.nonzero(seen[1:] > np.maximum(2.0 * seen[:-1], seen[:-1] + 1.0))[0]
        end = float(seen[gap[0]] if len(gap) else seen[-1])
        signal_power = np.sum(power[f <= end, joint] * (2 * np.pi * f[f <= end]) ** 4) * f[1]
        noise = (5.0 * NOISE_SHARE * signal_power / (floor[joint] * (2 * np.pi) ** 4)) ** 0.2
        ends.append(min(end, float(noise)))
    return float(np.clip(np.median(ends) if ends else LEAST, LEAST, min(MOST, rate / 10)))


def _even(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """The log at even times, by straight lines between its samples if it is not so already."""
    k = len(log.t)
    step = (log.t[-1] - log.t[0]) / (k - 1)
    even = log.t[0] + step * np.arange(k)
    if np.abs(even - log.t).max() < 1e-3 * step:
        return even, log.q, log.tau, log.dq
    q, tau = _at(even, log.t, log.q), _at(even, log.t, log.tau)
    return even, q, tau, None if log.dq is None else _at(even, log.t, log.dq)


def _at(even: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(even, t, column) for column in values.T], axis=1)


def _slope(values: np.ndarray, rate: float) -> np.ndarray:
    """The derivative by the five-point formula, whose error is of fourth order."""
    padded = np.pad(values, ((2, 2), (0, 0)), mode="reflect", reflect_type="odd")
    slope: np.ndarray = (8.0 * (padded[3:-1] - padded[1:-3]) - (padded[4:] - padded[:-4])) * (rate / 12.0)
    return slope


def _noise(velocity: np.ndarray, cut_off: float, rate: float) -> np.ndarray:
    """Standard deviation [n] of a velocity's noise after the wide filter, from the spectrum just above its band."""
    f, power = signal.welch(velocity, rate, nperseg=min(len(velocity), int(4 * rate)), axis=0, detrend="linear")
    wide = min(WIDER * cut_off, 0.4 * rate)
    density: np.ndarray = np.median(power[(f > wide) & (f <= max(2.0 * wide, 0.45 * rate))], axis=0)
    return np.sqrt(density * wide)


def _require_same(log: Log, ours: np.ndarray, theirs: np.ndarray) -> None:
    """Raises a DefinitionError if the log's velocities are not the slopes of its positions."""
    for joint, name in enumerate(log.joints):
        moving = np.sqrt(np.mean(ours[:, joint] ** 2))
        apart = np.sqrt(np.mean((theirs[:, joint] - ours[:, joint]) ** 2))
        if moving > 1e-2 and apart > 0.3 * moving:
            factor = float(np.sum(theirs[:, joint] * ours[:, joint]) / np.sum(ours[:, joint] ** 2))
            raise DefinitionError(
                f"`dq` of {log.source} is not the slope of `q` for joint `{name}`: it is {factor:.3g} times it at "
                "best; are the units rad and rad/s? Else leave `dq` out"
            )
