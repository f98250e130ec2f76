"""Linearised closed loop of one joint near zero error: one sampling period as a linear map, its stability and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .estimators import Measured
from .kalman import Kalman, StrongTracking
from .sampled.controller import SampledData

INPUTS = ("position noise", "velocity noise", "target", "disturbance", "disturbance at the end")
"""Inputs: noise of the measured position and velocity; the target of a plan, which is the led error at the plan's end
(`LinearLoop`); and the arm's acceleration disturbance at the start and at the end of the period, linear between."""

OUTPUTS = ("error", "velocity", "led", "predicted velocity", "command", "planned", "estimate")
"""Outputs: e and ė of the arm when a new torque sets in, a fractional delay after a sample; the predicted led error ŷ
and velocity; the commanded acceleration with and without the compensation of the estimated disturbance; and the
estimate ŵ after this sample."""


@dataclass(frozen=True)
class LoopMaps:
    """State-space matrices of a joint's loop over one period: `x⁺ = step x + enters u`, `y = outputs x + direct u`.

    The inputs u are `INPUTS`, the outputs y `OUTPUTS`. The unit of time is the period. The first two entries of x are e
    and ė of the arm.

    - `step`: [m m]; `enters`: [m 5]; `outputs`: [7 m]; `direct`: [7 5].
    """

    step: np.ndarray
    enters: np.ndarray
    outputs: np.ndarray
    direct: np.ndarray


@dataclass(frozen=True)
class LinearLoop:
    """Linear closed loop of a joint that responds to a commanded acceleration a with `q̈ = κ a`.

    The law assumes `q̈ = a`, and κ is an eigenvalue of `M⁻¹ M0`, nominal over true inertia (docs/sampled-data.md). Near
    e = 0 a law with a steep sliding surface plans `a = -(y/H + v)/H` with the led error `y = e + (H - h/2) v`. e and v
    are the errors of position and velocity, predicted over the delay from the estimate and the pending commands. The
    unit of time is the period.

    - `h`: the period [s]; `horizon`: H in periods.
    - `believed`: the delay that the law assumes, from a measurement until its torque acts [periods].
    - `gains`: gains of the estimator: (L1, L2 h, L3 h²) of `Kalman`, or (g, b, ahead) of `Measured`.
    - `measures_velocity`: True if the estimator is `Measured`.
    - `follows`: gain `1 - e^{-c h}` of the low-pass of a differenced velocity; None for a velocity sensor.
    """

    h: float
    horizon: float
    believed: float
    gains: tuple[float, float, float]
    measures_velocity: bool
    follows: float | None = None

    @classmethod
    def of(cls, law: SampledData, joint: int, cutoff: float | None = None) -> LinearLoop | None:
        """Return the loop of one joint; None for a law without a horizon.

        The result is also None for estimators other than `Kalman`, `StrongTracking` and `Measured`. `StrongTracking`,
        whose bandwidth grows with large innovations, counts with its least bandwidth.

        - `law`: law in sampled-data form.
        - `joint`: index of the joint, from 0.
        - `cutoff`: c of the low-pass of differenced velocities [rad/s]; None for a velocity sensor.
        """
        estimator = law.estimator
        if isinstance(estimator, StrongTracking):
            estimator = estimator.filter
        if law.horizon is None or not isinstance(estimator, Kalman | Measured):
            return None
        if isinstance(estimator, Kalman):
            numbers = np.broadcast_to(np.asarray(estimator.gains).reshape(3, -1), (3, law.joints))[:, joint]
            numbers = numbers * float(law.period) ** np.arange(3)
        else:
            each = (estimator.gain, estimator.trend, estimator.ahead)
            numbers = np.array([np.broadcast_to(np.asarray(gain), law.joints)[joint] for gain in each])
        first, second, third = (float(number) for number in numbers)
        return cls(
            h=float(law.period),
            horizon=float(law.horizon) / float(law.period),
            believed=float(law.believed_delay),
            gains=(first, second, third),
            measures_velocity=isinstance(estimator, Measured),
            follows=None if cutoff is None else -math.expm1(-cutoff * float(law.period)),
        )

    @property
    def bandwidth(self) -> float:
        """Bandwidth of the estimator [rad/s]: `∛(L3 h²)/h` for a Kalman filter, `g/h` for `Measured`.

        L3 h² is the third of the `gains`, g the first, and h the period.
        """
        gain, _, three = self.gains
        return (gain if self.measures_velocity else float(np.cbrt(three))) / self.h

    def radius(self, kappa: float = 1.0, delay: float | None = None) -> float:
        """Return the spectral radius of the loop over one period; below 1 the loop is stable.

        - `kappa`: κ, nominal over true inertia.
        - `delay`: the true delay [periods]; None for the believed one.
        """
        return float(np.max(np.abs(np.linalg.eigvals(self.maps(kappa, delay).step))))

    def stable_range(self, delay: float | None = None) -> tuple[float, float]:
        """Return the range of κ around 1 in which the loop is stable, within [1/64, 64].

        The result is (nan, nan) if the loop is unstable at κ = 1.

        - `delay`: the true delay [periods]; None for the believed one.
        """
        ends = []
        if self.radius(1.0, delay) >= 1.0:
            return math.nan, math.nan
        for direction in (-1.0, 1.0):
            steps = np.linspace(0.0, 6.0, 61)
            unstable = [x for x in steps if self.radius(2.0 ** (direction * x), delay) >= 1.0]
            if not unstable:
                ends.append(2.0 ** (6.0 * direction))
                continue
            outside, inside = unstable[0], unstable[0] - 0.1
            for _ in range(12):
                middle = 0.5 * (inside + outside)
                if self.radius(2.0 ** (direction * middle), delay) < 1.0:
                    inside = middle
                else:
                    outside = middle
            ends.append(2.0 ** (direction * inside))
        return ends[0], ends[1]

    def noise(self, variance: float, kappa: float = 1.0) -> tuple[float, float]:
        """Return the standard deviations of position and command that white position noise causes.

        The first is that of the position [rad or m]. The second is that of the commanded acceleration's change from
        sample to sample [rad/s² or m/s²]. Both are inf if the loop is unstable.

        - `variance`: variance of a measured position [rad² or m²].
        - `kappa`: κ, nominal over true inertia.
        """
        from scipy.linalg import solve_discrete_lyapunov

        maps = self.maps(kappa)
        matrix, enters = maps.step, maps.enters[:, 0]
        if np.max(np.abs(np.linalg.eigvals(matrix))) >= 1.0:
            return math.inf, math.inf
        covariance = solve_discrete_lyapunov(matrix, variance * np.outer(enters, enters))
        # The step is the difference of this command and the last; the noise of this sample affects it, too.
        row, own = maps.outputs[4], float(maps.direct[4, 0])
        step = row.copy()
        step[2] -= 1.0
        spread = step @ covariance @ step + variance * own * own
        return math.sqrt(max(covariance[0, 0], 0.0)), math.sqrt(max(spread, 0.0)) / self.h**2

    def maps(self, kappa: float = 1.0, delay: float | None = None) -> LoopMaps:
        """Return the state-space matrices of the loop over one period.

        - `kappa`: κ, nominal over true inertia.
        - `delay`: the true delay [periods]; None for the believed one.
        """
        delay = self.believed if delay is None else delay
        delayed, believed = math.ceil(delay), math.ceil(self.believed)
        queue = max(1, delayed, believed)
        # q, q̇, the commands (newest first), the prediction of q and q̇, the estimate ŵ, its rate, the last measurement.
        size = 2 + queue + 6
        columns = np.eye(size + len(INPUTS))
        state = columns[:size]
        noise_q, noise_v, target, disturbance, disturbance_next = columns[size:]
        q, v, commands = state[0], state[1], list(state[2 : 2 + queue])
        prior_q, prior_v, estimate, rate, last_q, last_v = state[2 + queue :]
        read_q, read_v = q + noise_q, v + noise_v
        if self.follows is not None:
            read_v = last_v + self.follows * (read_q - last_q - last_v)
        estimate_q, estimate_v, estimate, rate = self._estimated(read_q, read_v, prior_q, prior_v, estimate, rate)
        if self.follows is None or not self.measures_velocity:
            # Unused memory is set to zero: it would count as a mode that never settles.
            last_q, last_v = 0.0 * read_q, 0.0 * read_v
        else:
            last_q, last_v = read_q, read_v

        integer, fraction = int(self.believed), self.believed % 1.0
        now_q, now_v, following = estimate_q, estimate_v, None
        if fraction > 0:
            now_q, now_v = self._moved(now_q, now_v, commands[integer] + estimate, fraction)
        if integer > 0:
            following = self._moved(now_q, now_v, commands[integer - 1] + estimate, 1.0 - fraction)
            now_q, now_v = self._moved(now_q, now_v, commands[integer - 1] + estimate, 1.0)
        for i in range(integer - 1, 0, -1):
            now_q, now_v = self._moved(now_q, now_v, commands[i - 1] + estimate, 1.0)
        lead = self.horizon - 0.5
        led = now_q + lead * now_v
        planned = ((target - led) / self.horizon - now_v) / self.horizon
        command = planned - estimate
        if following is None:
            following = self._moved(now_q, now_v, planned, 1.0 - fraction)

        # The true arm, under the commands that act after the true delay and a disturbance that is linear in a period.
        sent = [command, *commands]
        integer, fraction = int(delay), delay % 1.0
        change = disturbance_next - disturbance
        within_q, within_v = q, v
        if fraction > 0:
            q, v = self._moved(q, v, kappa * sent[integer + 1], fraction)
            within_q = q + fraction * fraction * (0.5 * disturbance + fraction / 6.0 * change)
            within_v = v + fraction * (disturbance + 0.5 * fraction * change)
        q, v = self._moved(q, v, kappa * sent[integer], 1.0 - fraction)
        q, v = q + 0.5 * disturbance + change / 6.0, v + 0.5 * (disturbance + disturbance_next)
        after = np.array([q, v, *sent[:queue], *following, estimate, rate, last_q, last_v])
        outputs = np.array([within_q, within_v, led, now_v, command, planned, estimate])
        return LoopMaps(after[:, :size], after[:, size:], outputs[:, :size], outputs[:, size:])

    def _estimated(
        self,
        read_q: np.ndarray,
        read_v: np.ndarray,
        prior_q: np.ndarray,
        prior_v: np.ndarray,
        estimate: np.ndarray,
        rate: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        gain, two, three = self.gains
        if not self.measures_velocity:
            residual = read_q - prior_q
            return prior_q + gain * residual, prior_v + two * residual, estimate + three * residual, 0.0 * rate
        if two == 0.0:
            # A rate that nothing changes is set to zero: it would count as a mode that never settles.
            rate = 0.0 * rate
        grown = (1.0 - three) * rate
        surprise = read_v - prior_v - grown
        rate = rate + two * surprise
        return read_q, read_v, estimate + grown + gain * surprise + three * rate, rate

    def _moved(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, periods: float) -> tuple[np.ndarray, np.ndarray]:
        return q + periods * v + 0.5 * periods * periods * a, v + periods * a
