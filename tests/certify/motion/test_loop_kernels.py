"""Kernels of the scalar loop against an independent simulation of its equations."""

import numpy as np
import pytest

from slidax.certify.motion.joint_loop import OWN, JointLoop
from slidax.certify.motion.loop_kernels import _Trace, loop_kernels, spread_kernels
from slidax.core.errors import DefinitionError
from slidax.law.joint_loop import LinearLoop

LOOPS = {
    "fast": JointLoop.with_density(1e-3, 0.007, 3.0, 1e-5, 1),
    "slow": JointLoop.with_density(1e-3, 0.03, 0.01, 1e-6, 1),
    "500 Hz, two periods": JointLoop.with_density(2e-3, 0.03, 0.03, 1e-5, 2),
    "no delay": JointLoop.with_density(1e-3, 0.01, 1.0, 1e-5, 0),
}


def simulated(
    loop: JointLoop, w: np.ndarray, ratio: float = 1.0, noise: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """e, v, s when each period starts, for accelerations w [slots sub], constant in each substep."""
    h, delay = loop.period, loop.delay
    e = v = position = speed = push = 0.0
    pending = [(0.0, 0.0)] * delay
    results: dict[str, list[float]] = {"error": [], "velocity": [], "command": []}
    for k, inside in enumerate(w):
        residual = e + (0.0 if noise is None else noise[k]) - position
        position, speed, push = (x + g * residual for x, g in zip((position, speed, push), loop.gains, strict=True))
        at, rate = position, speed
        for i, (s, _) in enumerate(pending):
            a = s + push
            at, rate = at + h * rate + h * h / 2 * a, rate + h * a
            if i == 0:
                position, speed = at, rate
        pending.append((-loop.kp * at - loop.kd * rate - push, push))
        s, _ = pending.pop(0)
        if delay == 0:
            position, speed = position + h * speed + h * h / 2 * (s + push), speed + h * (s + push)
        for name, value in zip(results, (e, v, s), strict=True):
            results[name].append(value)
        dt = h / len(inside)
        for value in inside:
            a = ratio * (s + value)
            e, v = e + dt * v + dt * dt / 2 * a, v + dt * a
    return {name: np.array(values) for name, values in results.items()}


@pytest.mark.parametrize("name", LOOPS)
def test_disturbance_with_the_signs_of_the_kernel_attains_the_kernel_gain(name: str) -> None:
    loop = LOOPS[name]
    kernels = loop_kernels(loop)
    slots, sub = 600, 16
    for output in ("error", "velocity", "command"):
        impulse = np.zeros((slots, sub))
        impulse[0, :] = 1.0
        # Responses to a pulse at each substep of a period, which give the whole kernel.
        responses = np.stack(
            [simulated(loop, np.where(np.arange(sub) == i, impulse, 0.0))[output] for i in range(sub)], axis=1
        )
        signs = np.sign(responses[1:])[::-1]
        reached = simulated(loop, np.concatenate([signs, np.zeros((1, sub))]))[output][-1]
        gain = kernels[output].gain
        assert reached <= gain * (1 + 1e-9)
        assert reached >= 0.99 * gain


@pytest.mark.parametrize("name", LOOPS)
def test_responses_to_noise_and_ramps_come_near_their_kernel_gains_and_stay_below(name: str) -> None:
    loop, rng = LOOPS[name], np.random.default_rng(1)
    kernels = loop_kernels(loop)
    noise = rng.choice([-1e-5, 1e-5], size=1500)
    ramp = np.cumsum(np.repeat(rng.choice([-1.0, 1.0], size=(100, 1)), 15, axis=0), axis=0) * loop.period
    ramp = ramp + loop.period * np.array([0.25, 0.75])
    runs = simulated(loop, np.zeros((1500, 1)), noise=noise), simulated(loop, ramp - ramp[0, 0])
    for output in ("error", "velocity", "command"):
        noise_share = np.max(np.abs(runs[0][output])) / (1e-5 * kernels[output].noise.sum())
        assert 0.5 < noise_share <= 1.0
        ramp_share = np.max(np.abs(runs[1][output])) / kernels[output].ramp.sum()
        assert 0.15 < ramp_share <= 1.001


def test_response_deviation_is_bounded_for_random_inertia_ratios_in_the_band() -> None:
    loop, p = LOOPS["fast"], 0.1
    spreads = spread_kernels(loop, p)
    rng = np.random.default_rng(0)
    for ratio in rng.uniform(1 / (1 + p), 1 / (1 - p), size=8):
        for output in ("error", "velocity", "command"):
            w = rng.choice([-1.0, 1.0], size=(200, 1))
            nominal, other = (simulated(loop, w, ratio=value)[output] for value in (1.0, ratio))
            assert np.max(np.abs(other - nominal)) <= spreads[output].departure.gain
            assert np.max(np.abs(other)) <= spreads[output].largest.gain


@pytest.mark.parametrize("name", ["fast", "slow"])
def test_no_kernel_of_an_inertia_ratio_in_the_band_exceeds_the_largest_kernel(name: str) -> None:
    loop, p = LOOPS[name], 0.2
    spreads = spread_kernels(loop, p)
    least, most = 1 / (1 + p), 1 / (1 - p)
    sums, peaks = ("any_form", "ramp", "pulse", "noise", "goal"), ("step", "start_error", "start_speed", "start_miss")
    for ratio in np.random.default_rng(0).uniform(least, most, size=6):
        trace = _Trace.of(loop, loop.maps_for(ratio), ratio, spreads["error"].nominal.any_form.size - 1, 0.0)
        kernels = trace.kernels().by_output()
        for output, spread in spreads.items():
            own, largest = kernels[output], spread.largest
            for field in sums:
                assert np.sum(getattr(own, field)) <= np.sum(getattr(largest, field)), (output, field)
            for field in peaks:
                assert np.all(getattr(own, field) <= getattr(largest, field)), (output, field)


def test_deviation_gains_grow_with_the_width_of_the_band() -> None:
    gains = [spread_kernels(LOOPS["fast"], p)["error"].departure.gain for p in (0.0, 0.01, 0.02, 0.05, 0.1)]
    assert gains[0] < 1e-9 * gains[1]
    assert np.all(np.diff(gains) > 0.0)


def test_an_unstable_loop_is_refused() -> None:
    with pytest.raises(DefinitionError, match="unstable"):
        JointLoop.with_horizon(1e-3, 7e-3, (2.5, 0.0, 0.0), 1)
    with pytest.raises(DefinitionError, match="unstable"):
        spread_kernels(LOOPS["fast"], 0.7)


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.3])
def test_spectral_radius_of_the_certified_loop_agrees_with_the_laws_linear_loop(ratio: float) -> None:
    for loop in LOOPS.values():
        h = loop.period
        first, second, third = loop.gains
        law = LinearLoop(h, loop.kp**-0.5 / h, float(loop.delay), (first, second * h, third * h * h), False)
        radius = np.abs(np.linalg.eigvals(loop.maps_for(ratio).step)).max()
        np.testing.assert_allclose(radius, law.radius(ratio), rtol=1e-6)


def test_response_to_a_wrong_initial_filter_position_stays_within_its_kernel() -> None:
    loop = JointLoop.with_density(1e-3, 0.02, 1.0, 1e-5, 1)
    kernel = loop_kernels(loop)["error"]
    state = np.zeros(len(loop.maps.step))
    # The prediction and the pending command's position are wrong; the arm's position is right.
    state[[2, OWN]] = 1.0
    errors = []
    for _ in range(300):
        errors.append(abs(state[0]))
        state = loop.maps.step @ state
    assert np.max(errors) > 0.01
    assert (np.array(errors) <= kernel.start_miss[:300] + 1e-12).all()
    np.testing.assert_allclose(errors[:200], kernel.start_miss[:200], atol=1e-9)
