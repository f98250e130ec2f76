"""Each joint's inertia and the delay, estimated from a run's log in a frequency band around the loop's crossover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .run_record import RunRecord, band_pass, held_torque, resolvable_band

BAND = (20.0, 200.0)
"""Band around a loop's crossover [rad/s].

Below it, the weight of an unknown payload looks like a negative inertia. Above it, noise dominates.
"""

DELAYS = np.arange(0.0, 8.01, 0.25)
"""Delays to try [periods]."""

CLEAR = 3.0
"""Least ratio of acceleration to encoder noise in the band for an estimate of the inertia."""


@dataclass(frozen=True)
class LogEstimate:
    """Inertia of each joint [n] and delay, estimated from a log in the frequency band `BAND`.

    - `inertia`: estimated diagonal of the inertia matrix, kg m² or kg; NaN if the joint moves too little in the band.
    - `nominal`: mean diagonal of the nominal M0 over the samples, weighted by the squared acceleration.
    - `spread`: standard error of `inertia`.
    - `coherence`: share of each joint's torque in the band that the inertia explains.
    - `delay`: delay from a torque to its measured effect [periods]; NaN if no joint determines it.
    - `delay_gain`: relative decrease of the torque's unexplained share with `delay` in place of the law's own delay.
    """

    inertia: np.ndarray
    nominal: np.ndarray
    spread: np.ndarray
    coherence: np.ndarray
    delay: float
    delay_gain: float

    @property
    def kappa(self) -> np.ndarray:
        """κ of each joint, nominal over estimated inertia; NaN where it is unknown."""
        return np.where(self.inertia > 0, self.nominal / np.where(self.inertia > 0, self.inertia, 1.0), np.nan)


def estimate_from_log(record: RunRecord) -> LogEstimate:
    """Estimate the delay and each joint's inertia I_i by least squares, for each of the delays in `DELAYS`.

    The fit is `τ̄ - C0 q̇ - G0 - Σ_{j≠i} M0_ij a_j = I_i a_i`, with M0, C0 and G0 of the nominal arm. a is the second
    difference of the measured positions over h², with the period h. τ̄ is the mean torque over the two periods of this
    difference, shifted by the delay: for accelerations a₁ and a₂ that are constant in these periods, the second
    difference is exactly `h² (a₁ + a₂)/2`. Both sides are filtered in `BAND`. Encoder noise enlarges the sum of a²;
    the noise's share is subtracted. The delay with the best fit is chosen.
    """
    h = record.period
    q, tau, count = record.q, record.tau, len(record.t)
    mass, bias = (values[1:-1] for values in record.mass_and_bias)
    a = np.diff(q, 2, axis=0) / (h * h)
    filtered = band_pass(a, BAND, h)
    noise = _noise(record, len(a))
    coupled = band_pass(np.einsum("kij,kj->ki", mass, a) + bias, BAND, h)
    own = np.einsum("kii->ki", mass)
    square = np.sum(filtered * filtered, axis=0)
    clean = square - len(a) * noise**2
    known = clean > (CLEAR**2 - 1.0) * len(a) * noise**2
    safe = np.where(known, clean, 1.0)
    nominal = np.where(known, np.sum(own * filtered**2, axis=0) / np.where(square > 0, square, 1.0), own.mean(axis=0))

    extra, unexplained = [], []
    times = np.arange(1, count - 1)
    for delay in DELAYS:
        mean = 0.5 * (held_torque(tau, times - delay) + held_torque(tau, times - 1.0 - delay))
        rest = band_pass(mean, BAND, h) - coupled
        # The encoders' noise enlarges both sums.
        more = (np.sum(rest * filtered, axis=0) + nominal * len(a) * noise**2) / safe
        left = rest - more * filtered
        extra.append(more)
        unexplained.append(np.sum(left * left, axis=0) / np.sum((rest + nominal * filtered) ** 2 + 1e-300, axis=0))
    left = np.array(unexplained)[:, known]
    believed = int(np.argmin(np.abs(DELAYS - float(record.law.believed_delay))))
    best, gain = believed, 0.0
    if left.size:
        # Relative shares, so that every joint counts equally.
        best = int(np.argmin(np.mean(left, axis=1)))
        gain = float(1.0 - np.mean(left[best]) / max(np.mean(left[believed]), 1e-300))
    chosen = extra[best]
    share = unexplained[best]
    effective = max(len(a) * h * (resolvable_band(BAND, h)[1] - BAND[0]) / np.pi, 2.0)
    spread = np.sqrt(share / effective) * np.abs(nominal + chosen)
    inertia = np.where(known, nominal + chosen, np.nan)
    return LogEstimate(inertia, nominal, spread, 1.0 - share, float(DELAYS[best]) if left.size else float("nan"), gain)


def _noise(record: RunRecord, count: int) -> np.ndarray:
    """Return the standard deviation of the acceleration noise in the band [n], from the encoders' resolution."""
    chance = np.random.default_rng(0).standard_normal(count + 2)
    factor = float(np.std(band_pass(np.diff(chance, 2), BAND, record.period)))
    # At small speeds rounding is not white noise: half a step is conservative, the standard deviation is not.
    return factor / record.period**2 * encoder_resolution(record.q) / 2.0


def encoder_resolution(q: np.ndarray) -> np.ndarray:
    """The encoders' resolution, estimated from their readings [n], rad or m; 0 where these are not rounded.

    - `q`: measured positions [samples n].
    """
    steps_of_joint = []
    for column in q.T:
        steps = np.abs(np.diff(column))
        steps = steps[steps > 1e-12]
        least = float(np.min(steps)) if steps.size else 0.0
        ratio = steps / least if least else steps
        steps_of_joint.append(least if least and np.mean(np.abs(ratio - np.round(ratio)) < 1e-3) > 0.99 else 0.0)
    return np.array(steps_of_joint)


def believed_inertia(record: RunRecord, estimate: LogEstimate) -> np.ndarray:
    """Each joint's inertia in the law's model just before the run left its envelope [n], kg m² or kg.

    - `estimate`: the estimate from the same record; its `nominal` is the inertia before learning.
    """
    own = estimate.nominal
    if record.law.adaptation is None:
        return own
    learnt = record.signals["rotor"][record.before].mean(axis=0) - np.asarray(record.law.adaptation.counted)
    # The law's inertia is never below a small share of the nominal one (`with_rotors`).
    return np.maximum(own + learnt, 0.01 * own)
