"""The planned run of a law: of an arm that equals the law's model, from the initial set on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Reference, State
from slidax.controllers import SampledData
from slidax.controllers.steps.step import Moment
from slidax.scenarios import Scenario

from ..arm.motion import Motion
from ..each import Floats
from .entered import Entry
from .subject import Subject


@dataclass(frozen=True, eq=False)
class Ideal:
    """The nominal run: the law's step iterated on `q̈ = q̈_wanted` without model error, disturbance, noise or limits.

    All other members are bounded by their deviation from it; K times at which torques start.

    - `motion`: of this arm from the sample of the first decision [N n], with the reference's velocities.
    - `error`: e when each torque starts [K n], rad or m.
    - `target`: `x = y + H s⁺`, for which the plan's equation is solved [K n], rad or m; None if it follows from ε.
    - `eps`: its ε [K n].
    - `sliding`: s in the law's memory [K n], rad/s or m/s; `s_next`: s⁺ [K n].
    - `cover`: u [K], N m; inf for a law without one.
    - `push`: w* of this run itself [N n], and `rest`: its unexplained change in a period [N n], rad/s² or m/s²; None
      for a run without them.
    """

    motion: Motion
    error: Floats
    target: Floats | None
    eps: Floats
    sliding: Floats
    s_next: Floats
    cover: Floats
    push: Floats | None = None
    rest: Floats | None = None


def ideal_of(subject: Subject, entry: Entry) -> Ideal:
    """Return the planned run of a scenario's law, from an initial set to its end."""
    scenario, law = subject.scenario, subject.law
    h, dead, quiet = scenario.period, subject.dead_time, subject.quiet
    total = max(round(scenario.t1 / h), entry.sample + 4)
    set_in = (np.arange(entry.sample, total) + dead) * h
    begun = quiet + int(dead)
    part = (dead % 1.0) * h
    dq = entry.dq[begun]
    a = (entry.dq[begun + 1] - dq) / h
    first = State(jnp.asarray(entry.q[begun] + part * (dq + 0.5 * part * a)), jnp.asarray(dq + part * a))
    start = scenario.state0
    # As many as from the start of the run on, so that all entries share one compiled program.
    times = jnp.asarray(np.concatenate([set_in, np.full(total - set_in.size, set_in[-1])]))
    went = _followed(law, scenario.trajectory, start, first, jnp.asarray(entry.s), times)
    after, ddq, decided = jax.tree.map(lambda value: np.asarray(value)[: set_in.size], went)
    states = [
        np.concatenate([np.asarray(value)[None], many]) for value, many in zip((first.q, first.dq), after, strict=True)
    ]
    wanted = _references(scenario.trajectory, jnp.asarray(np.append(set_in, set_in[-1] + h)))
    e = states[0] - np.asarray(wanted.q)
    y = e + (float(law.horizon or h) - 0.5 * h) * (states[1] - np.asarray(wanted.dq))
    s_next = decided["s_next"]
    return Ideal(
        motion=_at_samples(scenario, entry, states, ddq, set_in, quiet),
        error=e[:-1],
        target=y[:-1] + float(law.horizon or h) * s_next,
        eps=decided["eps1"],
        sliding=decided["s"],
        s_next=s_next,
        cover=decided["cover"][:, 0],
    )


def _at_samples(
    scenario: Scenario, entry: Entry, states: list[Floats], ddq: Floats, set_in: Floats, quiet: int
) -> Motion:
    """The motion at the arm's samples: measured until the first torque starts, then planned."""
    h = scenario.period
    t = h * np.arange(entry.sample - quiet, round(set_in[-1] / h - 1e-9) + 1)
    k = np.searchsorted(set_in, t + 1e-9) - 1
    at = np.maximum(k, 0)
    since = (t - set_in[at])[:, None]
    q, dq = states[0][at] + since * (states[1][at] + 0.5 * since * ddq[at]), states[1][at] + since * ddq[at]
    measured = int(np.sum(k < 0))
    q[:measured], dq[:measured] = entry.q[:measured], entry.dq[:measured]
    wanted = np.asarray(_references(scenario.trajectory, jnp.asarray(t)).dq)
    return Motion(t[:-1], q[:-1], dq[:-1], np.diff(dq, axis=0) / h, wanted[:-1])


@eqx.filter_jit
def _references(trajectory: Any, t: Any) -> Reference:
    return jax.vmap(trajectory.reference)(t)


@eqx.filter_jit
def _followed(law: SampledData, trajectory: Any, start: State, first: State, s: Any, set_in: Any) -> Any:
    """Positions and velocities after each period, its acceleration, and the step's signals."""
    h, n = law.period, law.joints
    zero = jnp.zeros(())
    memory = law.step.init(zero, start, trajectory.reference(zero), h, law.horizon)
    memory = eqx.tree_at(lambda kept: kept.s, memory, s)

    def step(carry: Any, t: Any) -> Any:
        state, memory = carry
        here, there = trajectory.reference(t), trajectory.reference(t + h)
        mass = law.nominal.mass(state.q)
        if law.adaptation is not None:
            mass = law.adaptation.mass_at_start(mass)
        moment = Moment(
            t=t,
            state=state,
            reference=Reference(q=here.q, dq=here.dq, ddq=(there.dq - here.dq) / h),
            mass=mass,
            bias=law.nominal.bias(state.q, state.dq),
            robot=law.nominal,
            limits=law.limits,
            period=h,
            horizon=law.horizon,
            planned=jnp.ones((), bool),
            expected=state.dq,
        )
        decision = law.step(moment, memory)
        a = decision.acceleration
        after = State(q=state.q + h * (state.dq + 0.5 * h * a), dq=state.dq + h * a)
        signals = {name: decision.signals[name] for name in ("s", "s_next", "eps1")}
        signals["cover"] = jnp.full(n, jnp.inf) if decision.cover is None else jnp.broadcast_to(decision.cover, (n,))
        return (after, decision.memory), ((after.q, after.dq), a, signals)

    return jax.lax.scan(step, (first, memory), set_in)[1]
