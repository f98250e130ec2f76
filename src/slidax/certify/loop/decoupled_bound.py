"""Decoupled bound: coupling between joints enters as a disturbance of bounded magnitude."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from slidax.law.error_transformations import Sides
from slidax.law.joint_loop import LinearLoop

from ..arm.demand import Demand
from ..sampled_scenario import Floats
from .bound_recursion import (
    BoundProblem,
    BoundStart,
    CertifiedBounds,
    ErrorBounds,
    InitialBounds,
    LoopConstants,
    LoopResponses,
    StepInputs,
    bound_step,
    initial_carry,
)
from .envelope import pad_rows, solve_plan
from .joint_responses import (
    ACCELERATION,
    ERROR,
    ESTIMATE,
    LED,
    OUTPUTS,
    JointResponses,
    initial_directions,
    kappa_grid,
    simulate_loop,
    steady_states,
)
from .problem import LoopProblem

BLOCK = 32
"""Samples whose earlier inputs are summed at once: a trade-off between sequential and parallel work."""


@dataclass(frozen=True)
class DecoupledLoops:
    """The loops of the joints, each for some κ; units of periods.

    - `kernels`: sizes of responses to disturbances, targets and changes of target, the newest last [9 n j L] each.
    - `tails`: bounds of the effect of older inputs, of each, times their largest, faded.
    - `fading`: a period's share of that [n j].
    - `spread`: bound of `|κ(t)/κ - 1|` for each κ [n j]; `kappa`: these κ [n j].
    - `coupling`: of the joints' accelerations [n n].
    """

    kernels: tuple[Any, Any, Any]
    tails: tuple[Any, Any, Any]
    fading: Any
    spread: Any
    kappa: Any
    coupling: Any


jax.tree_util.register_dataclass(DecoupledLoops, data_fields=list(DecoupledLoops.__dataclass_fields__), meta_fields=[])


def propagate_decoupled(
    course: LoopConstants, apart: DecoupledLoops, passing: StepInputs, first: InitialBounds, most: int = 0
) -> ErrorBounds:
    """Return the bounds of all samples, over all κ.

    - `most`: largest number of samples of all calls that share the compiled program.
    """
    count = passing.now.shape[0]
    blocks = -(-max(count, most) // BLOCK)

    # Padding after the last sample does not affect earlier samples, and is cut off.
    def in_blocks(values: Any) -> Any:
        whole = pad_rows(values, blocks * BLOCK)
        return jnp.asarray(whole.reshape(blocks, BLOCK, *whole.shape[1:]))

    bounds = _scanned(course, apart, jax.tree.map(in_blocks, passing), first)
    return ErrorBounds(*(np.asarray(values).reshape(-1, *values.shape[2:])[:count] for values in bounds))


@functools.partial(jax.jit)
def _scanned(course: LoopConstants, apart: DecoupledLoops, passing: StepInputs, first: InitialBounds) -> Any:
    """A block's samples one after the other, after the effect of all earlier inputs is summed for the whole block.

    So the long responses are read once a block, as a product of matrices, and at each sample only their first lags.
    """
    _, n, j, length = apart.kernels[0].shape
    short = min(BLOCK, length)
    beginnings = tuple(kernel[..., -short:] for kernel in apart.kernels)
    windows = jnp.arange(BLOCK)[:, None] + 1 + jnp.arange(length)[None]

    def before_it(kernel: Any, history: Any) -> Any:
        """Of all that came in before the block, at each of its samples; what comes in within it is not yet known."""
        padding = jnp.zeros((n, j, BLOCK))
        windowed = jnp.concatenate([history, padding], axis=-1)[..., windows]
        return jnp.einsum("onjl,njbl->bonj", kernel, windowed)

    def split_acceleration(acceleration: Any, stray: Any) -> tuple[Any, Any]:
        strayed = apart.kappa * stray[:, None]
        moved = acceleration + strayed
        others = apart.coupling @ jnp.max((1.0 + apart.spread) * moved, axis=1)
        return apart.spread * moved + others[:, None] + strayed, moved + others[:, None]

    def step(carry: Any, at: Any) -> Any:
        begun, recent, most, carried = carry
        at, olds = at

        def past(old: Any, kernel: Any, window: Any, tail: Any, largest: Any) -> Any:
            return old + jnp.sum(kernel[..., :-1] * window[..., 1:], axis=-1) + tail * largest

        parts = zip(olds, beginnings, recent, apart.tails, most, strict=True)
        answers = LoopResponses(
            before=tuple(past(*arrays) for arrays in parts),
            newest=lambda kind, value: apart.kernels[kind][..., -1] * value,
            split_acceleration=lambda acceleration: split_acceleration(acceleration, at.stray),
        )
        carried, entered, bounds = bound_step(course, first, at, begun, carried, answers)
        recent = tuple(_shifted(arrays, new[..., None]) for arrays, new in zip(recent, entered, strict=True))
        most = tuple(jnp.maximum(apart.fading * old, new) for old, new in zip(most, entered, strict=True))
        return (jnp.array(True), recent, most, carried), (entered, bounds)

    def block(carry: Any, ats: Any) -> Any:
        begun, histories, most, carried = carry
        olds = tuple(before_it(*arrays) for arrays in zip(apart.kernels, histories, strict=True))
        recent = (jnp.zeros((n, j, short)),) * 3
        inner = (begun, recent, most, carried)
        (begun, _, most, carried), (entered, bounds) = jax.lax.scan(step, inner, (ats, olds))
        histories = tuple(
            _shifted(arrays, jnp.moveaxis(new, 0, -1)) for arrays, new in zip(histories, entered, strict=True)
        )
        return (begun, histories, most, carried), bounds

    history, nil = jnp.zeros((n, j, length)), jnp.zeros((n, j))
    at_first = initial_carry(jax.tree.map(lambda arrays: arrays[0], passing), first, j)
    return jax.lax.scan(block, (jnp.array(False), (history,) * 3, (nil,) * 3, at_first), passing)[1]


def _shifted(history: Any, new: Any) -> Any:
    """The history with new values appended, of the same length."""
    return jnp.concatenate([history, new], axis=-1)[..., -history.shape[-1] :]


Known: TypeAlias = tuple[Floats, Floats, Floats]
"""Responses without p and with some p held [N 2 9 n j] each, and the curvature effect on e [N n j]."""


class DecoupledProblem(BoundProblem):
    """Error bounds for given disturbance bounds, reusable across fixed-point iterations.

    Each joint's loop is bounded alone, and the coupling between joints counts as a disturbance.

    - `chance`: probability that normal noise exceeds its bound at some sample of the run.
    """

    def __init__(
        self, subject: LoopProblem, demand: Demand, chance: float = 1e-3, since: BoundStart | None = None
    ) -> None:
        super().__init__(subject, demand, since)
        # A joint whose own inertia the others outweigh answers a torque the wrong way: no loop of it settles.
        answers = bool(np.all(demand.kappa > 0))
        self.kappa, self.spread = (
            kappa_grid(demand.kappa) if answers else (demand.kappa.T, np.zeros_like(demand.kappa.T))
        )
        self.kernels = JointResponses.of(subject.loops, self.kappa) if answers else None
        if self.kernels is None:
            return
        times = self.samples * subject.law.joints * OUTPUTS
        self.noise_size = self.noise.size(self.period, self.kernels.noise, self.kernels.noise_square, times, chance)
        self.noise_start = self.noise.start(self.period, times, chance)
        self.known, self.first = started(self) if since is None else initial_bounds(self)

    @property
    def stable(self) -> bool:
        """True if all loops are stable."""
        return self.kernels is not None

    @property
    def signed_error(self) -> Floats:
        """Effect on e of an acceleration that is constant over a period, by the lag, for the middle κ [n L]."""
        assert self.kernels is not None
        length = self.kernels.of_disturbance.shape[-1]
        responses = []
        for loop, row in zip(self.subject.loops, self.kappa, strict=True):
            maps = loop.maps(float(row[row.size // 2]))
            state = maps.enters[:, 3] + maps.enters[:, 4]
            errors = []
            for _ in range(length):
                errors.append(maps.outputs[0] @ state)
                state = maps.step @ state
            responses.append(errors)
        return np.array(responses)

    def certified(self, more: Floats | None = None, misread: Floats | None = None) -> CertifiedBounds:
        """The bounds.

        - `more`: additional disturbance at each sample of the arm, beyond `demand.stray` [N n], rad/s² or m/s².
        - `misread`: prediction error of a command [N n], likewise.
        """
        bounds = propagate_decoupled(self.course, self._apart(), self._passing(more, misread), self.first, self.most)
        error, share = self.error_of(bounds)
        noise = np.max(self.noise_size[ERROR], axis=1)
        return CertifiedBounds(self.subject, self.narrowing, bounds, error, share, self.kappa, self.spread, noise)

    def _apart(self) -> DecoupledLoops:
        kernels = self.kernels
        assert kernels is not None
        disturbance, place, change = (
            jnp.asarray(kernel[..., ::-1]) for kernel in (kernels.of_disturbance, kernels.of_place, kernels.of_change)
        )
        return DecoupledLoops(
            kernels=(disturbance, place, change),
            tails=(
                jnp.asarray(kernels.disturbance_tail),
                jnp.asarray(kernels.place_tail),
                jnp.asarray(kernels.change_tail),
            ),
            fading=jnp.asarray(kernels.fading),
            spread=jnp.asarray(self.spread),
            kappa=jnp.asarray(self.kappa),
            coupling=jnp.asarray(self.demand.coupling),
        )

    def _passing(self, more: Floats | None, misread: Floats | None) -> StepInputs:
        narrowing, sliding = self.narrowing, self.sliding
        free, held, bend = self.known
        if misread is not None:
            extra = self._misled(misread)
            free, held = free + extra, held + extra
        stray = self.strayed(more)
        target, eps, turn = self.planned()
        inputs = (narrowing.now, narrowing.ahead, free, held, stray, bend, target, eps, turn)
        reached = (sliding.size, sliding.s_next, sliding.root, sliding.mass, sliding.grown)
        return StepInputs(*(jnp.asarray(values) for values in (*inputs, *reached)))

    def _misled(self, misread: Floats) -> Floats:
        """Bound of the effect of commands computed for wrong predictions."""
        assert self.kernels is not None
        length = self.kernels.of_disturbance.shape[-1]
        extra: Floats = self.recent(misread, length)[:, None, None, :, None] * self.kernels.of_command[None, None]
        if self.demand.relearning is not None:
            moved = self.recent(self.demand.relearning, length)
            extra = extra + moved[:, None, None, :, None] * self.kernels.of_estimate[None, None]
        return extra


def started(assembly: DecoupledProblem) -> tuple[Known, InitialBounds]:
    """Return the known responses of the loops, and bounds at the first sample, from the scenario's start."""
    narrowing, lead = assembly.narrowing, assembly.narrowing.lead
    noise = np.max(assembly.noise_size[LED], axis=1) + assembly.noise_start[0] + lead * assembly.noise_start[1]
    now, ahead = narrowing.now[0], narrowing.ahead[0]
    spread = ahead / now * (noise + assembly.horizon * assembly.subject.cover()[1])
    spread = np.minimum(spread, ahead * (narrowing.upper - narrowing.lower))
    y = assembly.e + lead * assembly.de
    sides = Sides(jnp.asarray(narrowing.lower), jnp.asarray(narrowing.upper))
    both = jnp.stack([jnp.maximum(-jnp.asarray(y), 0.0), jnp.maximum(jnp.asarray(y), 0.0)])
    surface, horizon = assembly.subject.surface, jnp.asarray(assembly.horizon)
    place = solve_plan(surface, sides, jnp.asarray(now), horizon, both, jnp.zeros_like(both))[1]
    aims = ahead * np.asarray(place[1] - place[0])
    begun = np.stack([np.maximum(-assembly.e, 0.0), np.maximum(assembly.e, 0.0)])
    return _known_of(assembly, aims), InitialBounds.of(begun, spread, np.abs(aims - y) + spread + noise)


def initial_bounds(assembly: DecoupledProblem) -> tuple[Known, InitialBounds]:
    """Return the known responses of the loops, and bounds at the first sample, from the initial set."""
    assert assembly.since is not None
    free, bend = _known_response(assembly)
    held = free.copy()
    known = np.max(free[0, :, LED], axis=(0, 2))
    narrowing = assembly.narrowing
    slope = assembly.course.slopes.between(*(jnp.asarray(assembly.since.ideal.eps[0]),) * 2)[0]
    follows = narrowing.ahead[0] / (narrowing.now[0] + assembly.horizon * np.asarray(slope))
    for i, loop in enumerate(assembly.subject.loops):
        basis, sizes = initial_directions(loop, float(follows[i]), assembly.since.states[:, :, i])
        for j, kappa in enumerate(assembly.kappa[i]):
            for column, size in zip(basis.T, sizes, strict=True):
                if size > 0.0:
                    alone, kept = _from(assembly, loop, kappa, column, float(follows[i]))
                    free[:, :, :, i, j] += size * np.abs(alone.T)[:, None]
                    held[:, :, :, i, j] += size * np.abs(kept.T)[:, None]
    error = np.max(free[0, :, ERROR], axis=2)
    slid = np.abs(assembly.since.slid)
    size = float(np.sqrt(slid @ assembly.sliding.mass[0] @ slid))
    return (free, held, bend), InitialBounds.of(error, known, np.full_like(known, np.inf), size, follows)


def _from(
    assembly: DecoupledProblem, loop: LinearLoop, kappa: float, state: Floats, follows: float
) -> tuple[Floats, Floats]:
    """Response of a loop from a state without p, and with the p held that ŷ has at the start [9 N] each."""
    nothing = np.zeros((1, 2))
    alone = simulate_loop(loop, kappa, nothing, 0.0, state, assembly.samples).outputs[:, 0]
    place = follows * float(alone[LED, 0])
    return alone, simulate_loop(loop, kappa, nothing, place, state, assembly.samples).outputs[:, 0]


def _known_of(assembly: DecoupledProblem, aims: Floats) -> Known:
    """Response of the loops to known inputs, without p and with the first held [N 2 9 n j], and the bend of e [N n j].

    Below and above zero, in size.
    """
    free, bend = _known_response(assembly)
    alone = np.empty((assembly.samples, OUTPUTS, *assembly.kappa.shape))
    nothing = np.zeros((1, 2))
    for i, loop in enumerate(assembly.subject.loops):
        still = np.zeros_like(_begun(assembly, i))
        for j, kappa in enumerate(assembly.kappa[i]):
            signals = simulate_loop(loop, kappa, nothing, aims[i], still, assembly.samples, assembly.quiet)
            alone[:, :, i, j] = signals.outputs[:, 0].T
    return free, free + alone[:, None] * np.array([-1.0, 1.0])[:, None, None, None], bend


def _known_response(assembly: DecoupledProblem) -> tuple[Floats, Floats]:
    """Response of the loops from their start to the known disturbances, with noise."""
    h, (n, cells) = assembly.period, assembly.kappa.shape
    known = np.empty((assembly.samples, 2, OUTPUTS, n, cells))
    bend = np.empty((assembly.samples, n, cells))
    curve = 12.0 if assembly.subject.dead_time % 1.0 == 0 else 4.0
    for i, loop in enumerate(assembly.subject.loops):
        disturbance = assembly.demand.disturbance[:, :, i] * h * h
        begun = _begun(assembly, i) if assembly.since is None else steady_states(loop, disturbance[:, 0])
        for j, kappa in enumerate(assembly.kappa[i]):
            signals = simulate_loop(loop, kappa, disturbance, 0.0, begun, assembly.samples, assembly.quiet)
            extra = assembly.noise_size[:, i, j, None] + _first_noise(assembly, i, kappa)
            outputs = signals.outputs.copy()
            # Of the estimate what it misses of the disturbance as it is when the torque sets in.
            outputs[ESTIMATE] -= disturbance[:, assembly.late : assembly.late + assembly.samples]
            outputs[ACCELERATION] += kappa * signals.least
            known[:, 0, :, i, j] = (np.max(-outputs, axis=1) + extra).T
            outputs[ACCELERATION] += kappa * (signals.most - signals.least)
            known[:, 1, :, i, j] = (np.max(outputs, axis=1) + extra).T
            bend[:, i, j] = kappa * np.max(signals.change, axis=0) / curve
    return known, bend


def _first_noise(assembly: DecoupledProblem, joint: int, kappa: float) -> Floats:
    """Effect of the noise of the first measurement, which is the first prediction as well [9 N]."""
    loop, queue, noise = assembly.subject.loops[joint], _queue(assembly, joint), np.zeros((OUTPUTS, assembly.samples))
    if assembly.since is not None:
        # It is among what was seen.
        return noise
    for k, size in enumerate(assembly.noise_start):
        if size[joint]:
            state = np.zeros_like(_begun(assembly, joint))
            state[2 + queue + k] = size[joint]
            noise += np.abs(simulate_loop(loop, kappa, np.zeros((1, 2)), 0.0, state, assembly.samples).outputs[:, 0])
    return noise


def _queue(assembly: DecoupledProblem, joint: int) -> int:
    return int(max(1, np.ceil(assembly.subject.loops[joint].believed)))


def _begun(assembly: DecoupledProblem, joint: int) -> Floats:
    """The loop's state at its first measurement, `quiet` periods before the start."""
    queue, quiet, h = _queue(assembly, joint), assembly.subject.quiet, assembly.period
    state = np.zeros(2 + queue + 6)
    speed = assembly.de[joint] * h
    state[0], state[1] = assembly.e[joint] - quiet * speed, speed
    # The arm is held until the first command sets in: behind a reference that accelerates.
    acts = np.arange(queue, 0, -1) - 1
    held = int(assembly.subject.dead_time) - 1 - acts[::-1] >= 0
    state[2 : 2 + queue] = np.where(held, -assembly.ddq[joint] * h * h, 0.0)
    state[2 + queue], state[3 + queue] = state[0], state[1]
    state[-2:] = state[:2] if _remembers(assembly, joint) else 0.0
    return state


def _remembers(assembly: DecoupledProblem, joint: int) -> bool:
    loop = assembly.subject.loops[joint]
    return loop.measures_velocity and loop.follows is not None
