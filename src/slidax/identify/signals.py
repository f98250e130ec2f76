"""Evenly sampled, smoothed signals of a log with their derivatives, and the low-pass filter of the regression.

The regression passes both sides of each torque equation, torque and regressor, through the same zero-phase low-pass
filter. This is the equations' filter below, and the band is the range up to its cut-off frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import interpolate, signal

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError

from .log_checks import LogPieces, find_usable_velocities
from .regressor import JointMotion

ORDER = 4
"""Order of the Butterworth filters, which run forwards and backwards and so have no delay."""

WIDER = 4.0
"""Cut-off frequency of the positions' filter, as a multiple of that of the equations' filter: the band is unchanged."""

SNR = 10.0
"""Least ratio of the positions' spectrum to the noise's in the band."""

NOISE_SHARE = 1e-4
"""Largest share of noise in an acceleration's power in the band; noise lowers an estimated inertia by this share."""

LEAST, MOST = 1.0, 30.0
"""Range of the cut-off frequency [Hz]: above it, drives and links are no longer rigid."""


@dataclass(frozen=True, eq=False)
class LogSignals:
    """An evenly sampled log, in pieces without gaps, with smoothed velocities and accelerations.

    - `t`: times [k], s.
    - `motion`: smoothed positions, velocities and accelerations.
    - `tau`: torques as measured [k n], N m or N.
    - `cut_off`: cut-off frequency of the equations' filter [Hz].
    - `noise`: standard deviation of the velocities' noise [n], rad/s or m/s.
    - `rate`: sampling rate within a piece [Hz].
    - `pieces`: evenly sampled rows; filters and derivatives do not cross their ends.
    - `measured`: True for rows near samples of the log [k].
    - `warnings`: sentences on data that was left out.
    """

    t: np.ndarray
    motion: JointMotion
    tau: np.ndarray
    cut_off: float
    noise: np.ndarray
    rate: float
    pieces: tuple[slice, ...]
    measured: np.ndarray
    warnings: tuple[str, ...] = ()

    @cached_property
    def _sos(self) -> np.ndarray:
        return signal.butter(ORDER, self.cut_off, fs=self.rate, output="sos")

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """Return columns, such as torques or a regressor, after the equations' zero-phase low-pass filter, [k ...]."""
        return _per_piece(lambda values: signal.sosfiltfilt(self._sos, values, axis=0), columns, self.pieces)

    def slope(self, columns: np.ndarray) -> np.ndarray:
        """Return the time derivative of the columns, [k ...]."""
        return _per_piece(lambda values: np.gradient(values, 1.0 / self.rate, axis=0), columns, self.pieces)

    def spectrum(self, values: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies [Hz] and power spectral densities of the columns, averaged over the pieces.

        - `values`: columns [k n].
        - `seconds`: length of a window; shorter if no piece is that long.
        """
        return _spectrum(values, self.rate, self.pieces, seconds)

    def torque_noise(self) -> np.ndarray:
        """Return the standard deviation [n] of the torques' noise below the cut-off, from the spectrum above it."""
        f, power = self.spectrum(self.tau, 4.0)
        above = (f > 3.0 * self.cut_off) & (f < 0.45 * self.rate)
        density = np.median(power[above], axis=0) if above.sum() > 3 else np.zeros(self.tau.shape[1])
        return np.sqrt(density * self.cut_off)

    def part(self, rows: slice) -> LogSignals:
        """Return the signals in a range of rows.

        - `rows`: rows with a start and a stop.
        """
        a, b = rows.start, rows.stop
        cut = [slice(max(p.start, a) - a, min(p.stop, b) - a) for p in self.pieces if p.start < b and p.stop > a]
        motion = JointMotion(*(values[rows] for values in self.motion))
        return replace(
            self,
            t=self.t[rows],
            motion=motion,
            tau=self.tau[rows],
            pieces=tuple(cut),
            measured=self.measured[rows],
        )

    @property
    def settled(self) -> int:
        """Settling time of the equations' filter at each end of a piece, in samples."""
        return math.ceil(self.rate / self.cut_off)

    @cached_property
    def inner(self) -> np.ndarray:
        """True for measured rows at which the equations' filter has settled [k]."""
        inner: np.ndarray = np.zeros(len(self.t), bool)
        for piece in self.pieces:
            if piece.stop - piece.start > SHORTEST:
                inner[piece.start + self.settled : max(piece.stop - self.settled, piece.start + self.settled)] = True
        inner &= self.measured
        return inner


def signals_of(timed: LogPieces, robot: Articulated, cut_off: float | None = None) -> LogSignals:
    """Resample a log evenly, smooth it and differentiate it.

    Measured velocities are used where they are less noisy than the derivative of the positions, and agree with it.

    - `timed`: the log, in pieces.
    - `cut_off`: cut-off frequency of the equations' filter [Hz]; chosen from the positions' spectrum by default.

    Raises DefinitionError if no piece is long enough, or if the cut-off is not below a quarter of the sampling rate.
    """
    log = timed.log
    t, q, tau, dq, measured, pieces = _resample(timed)
    rate = 1.0 / (t[pieces[0].start + 1] - t[pieces[0].start])
    chosen = choose_cut_off(q, rate, pieces) if cut_off is None else float(cut_off)
    if not 0 < chosen < rate / 4:
        raise DefinitionError(
            f"`cut_off` must be > 0 and < {rate / 4:.4g} Hz, a quarter of the sampling rate; got {chosen:g}"
        )
    wide = signal.butter(ORDER, min(WIDER * chosen, 0.4 * rate), fs=rate, output="sos")
    smooth = _per_piece(lambda values: signal.sosfiltfilt(wide, values, axis=0), q, pieces)
    velocity = _slope(smooth, rate, pieces)
    noise = _noise(_slope(q, rate, pieces), chosen, rate, pieces)
    warnings = list(timed.warnings)
    if dq is not None:
        narrow = signal.butter(ORDER, chosen, fs=rate, output="sos")
        measured_velocity = _per_piece(lambda values: signal.sosfiltfilt(wide, values, axis=0), dq, pieces)
        band = [
            _per_piece(lambda values: signal.sosfiltfilt(narrow, values, axis=0), v, pieces) for v in (velocity, dq)
        ]
        usable, sentences = find_usable_velocities(log, robot, band[0], band[1], 0.5 * noise, rate)
        warnings += sentences
        measured_noise = _noise(dq, chosen, rate, pieces)
        # Use the velocity with less noise just above the band.
        better = usable & (measured_noise < noise)
        velocity, noise = np.where(better, measured_velocity, velocity), np.where(better, measured_noise, noise)
    motion = JointMotion(smooth, velocity, _slope(velocity, rate, pieces))
    signals = LogSignals(t, motion, tau, chosen, noise, rate, pieces, measured, tuple(warnings))
    if not signals.inner.any():
        raise DefinitionError(
            f"{log.source} is too short: its longest part without a gap is "
            f"{max(p.stop - p.start for p in pieces) / rate:.3g} s, but the filter of {chosen:.3g} Hz needs "
            f"{2.5 * signals.settled / rate:.3g} s; `--cut-off` sets another filter"
        )
    return signals


def choose_cut_off(q: np.ndarray, rate: float, pieces: tuple[slice, ...]) -> float:
    """Choose the frequency [Hz] up to which the positions exceed their noise.

    Encoder noise is white, so the upper part of the spectrum shows its density S. The band ends where a joint's
    spectrum falls to 10 S, or where the noise of its acceleration, `S (2π)⁴ f⁵/5`, reaches a share of 1e-4 of the
    acceleration's power, whichever is lower. The result is the median over the joints, within 1 Hz to 30 Hz and at most
    a tenth of the sampling rate.

    - `q`: evenly sampled positions [k n].
    - `rate`: sampling rate [Hz].
    - `pieces`: rows without a gap.
    """
    f, power = _spectrum(q, rate, pieces, 8.0)
    floor = np.maximum(np.median(power[(f > 0.3 * rate) & (f < 0.475 * rate)], axis=0), 1e-30)
    ends = []
    for joint in range(q.shape[1]):
        above = power[:, joint] > SNR * floor[joint]
        if not above[1:4].any():
            continue  # The joint does not move.
        # A line spectrum has gaps: take the last frequency above the floor before a gap of an octave.
        visible = f[above & (f > 0)]
        gap = np.nonzero(visible[1:] > np.maximum(2.0 * visible[:-1], visible[:-1] + 1.0))[0]
        end = float(visible[gap[0]] if len(gap) else visible[-1])
        signal_power = np.sum(power[f <= end, joint] * (2 * np.pi * f[f <= end]) ** 4) * f[1]
        noise = (5.0 * NOISE_SHARE * signal_power / (floor[joint] * (2 * np.pi) ** 4)) ** 0.2
        ends.append(min(end, float(noise)))
    return float(np.clip(np.median(ends) if ends else LEAST, LEAST, min(MOST, rate / 10)))


def _resample(
    timed: LogPieces,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None, np.ndarray, tuple[slice, ...]]:
    """Return evenly sampled times, positions, torques and velocities, the rows that were measured, and the pieces.

    Pieces with the even step of the longest piece keep their samples. The others are interpolated by a monotone cubic
    curve, which does not overshoot.
    """
    log = timed.log
    longest = max(timed.pieces, key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start < 3:
        raise DefinitionError(f"{log.source} has no three samples without a gap: nothing can be identified")
    step = (log.t[longest.stop - 1] - log.t[longest.start]) / (longest.stop - longest.start - 1)
    parts, pieces, end = [], [], 0
    for piece in timed.pieces:
        own = log.t[piece]
        points = 1 + int((own[-1] - own[0]) / step + 1e-3)
        if points < 3:
            continue
        even = own[0] + step * np.arange(points)
        columns = [log.q[piece], log.tau[piece], *([] if log.dq is None else [log.dq[piece]])]
        offset = np.abs(even - own).max() if points == len(own) else np.inf
        between = [] if offset < 1e-3 * step else _interpolate(own, np.minimum(even, own[-1]), columns)
        if offset < 1e-3 * step or (offset < step and _roughness(columns[0]) < _roughness(between[0])):
            # Evenly sampled, although the time stamps may jitter.
            values, measured = columns, np.ones(points, bool)
        else:
            values, even = between, np.minimum(even, own[-1])
            after = np.clip(np.searchsorted(own, even), 1, len(own) - 1)
            measured = own[after] - own[after - 1] < 3.0 * step
            even = own[0] + step * np.arange(points)
        parts.append((even, values[0], values[1], values[-1], measured))
        pieces.append(slice(end, end + points))
        end += points
    t, q, tau, dq, measured = (np.concatenate(part) for part in zip(*parts, strict=True))
    return t, q, tau, None if log.dq is None else dq, measured, tuple(pieces)


def _interpolate(own: np.ndarray, even: np.ndarray, columns: list[np.ndarray]) -> list[np.ndarray]:
    return [interpolate.PchipInterpolator(own, column, axis=0)(even) for column in columns]


def _roughness(q: np.ndarray) -> float:
    """Return the relative size of the third differences, summed over the joints; 0 for fewer than four samples."""
    if len(q) < 4:
        return 0.0
    return float(np.sum(np.std(np.diff(q, 3, axis=0), axis=0) / (np.std(q, axis=0) + 1e-12)))


def _per_piece(work: Callable[[np.ndarray], np.ndarray], values: np.ndarray, pieces: tuple[slice, ...]) -> np.ndarray:
    """Return values with a function applied to each piece; pieces too short for the filters stay unchanged."""
    done = np.array(values, float)
    for piece in pieces:
        if piece.stop - piece.start > SHORTEST:
            done[piece] = work(values[piece])
    return done


SHORTEST = 40
"""A piece must have more rows than this to be filtered; the filters' padding needs fewer."""


def _slope(values: np.ndarray, rate: float, pieces: tuple[slice, ...]) -> np.ndarray:
    """Return the time derivative by the five-point formula, with an error of fourth order."""

    def five_points(piece: np.ndarray) -> np.ndarray:
        padded = np.pad(piece, ((2, 2), (0, 0)), mode="reflect", reflect_type="odd")
        return (8.0 * (padded[3:-1] - padded[1:-3]) - (padded[4:] - padded[:-4])) * (rate / 12.0)

    slope = np.zeros_like(values)
    for piece in pieces:
        slope[piece] = five_points(values[piece])
    return slope


def _spectrum(
    values: np.ndarray, rate: float, pieces: tuple[slice, ...], seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz] and Welch's spectral densities, averaged over the pieces at least as long as a window.

    A window is as long as `seconds`, but at most as long as the longest piece.
    """
    window = max(min(max(p.stop - p.start for p in pieces), int(seconds * rate)), 2)
    total, weight, f = 0.0, 0, np.zeros(0)
    for piece in pieces:
        length = piece.stop - piece.start
        if length >= window:
            f, power = signal.welch(values[piece], rate, nperseg=window, axis=0, detrend="linear")
            total, weight = total + length * power, weight + length
    return f, np.asarray(total / weight)


def _noise(velocity: np.ndarray, cut_off: float, rate: float, pieces: tuple[slice, ...]) -> np.ndarray:
    """Return the standard deviation [n] of a velocity's noise after the positions' filter, from the spectrum above."""
    f, power = _spectrum(velocity, rate, pieces, 4.0)
    wide = min(WIDER * cut_off, 0.4 * rate)
    above = (f > wide) & (f <= max(2.0 * wide, 0.45 * rate))
    density: np.ndarray = np.median(power[above], axis=0) if above.any() else np.zeros(velocity.shape[1])
    return np.sqrt(density * wide)
