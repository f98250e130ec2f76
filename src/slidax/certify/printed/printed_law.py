"""Sliding-mode laws in the form that the paper prints, and the assumptions of certificates in continuous time.

The printed form is the torque of the paper's (41) to (45) and (51), computed from the present state. The other form,
sampled data, plans the torque over a period.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.analysis.run_record import inertia_and_bias
from slidax.arms.arm import AbstractRobot
from slidax.core.linear_algebra import is_positive_definite
from slidax.core.types import State
from slidax.law.envelopes import AbstractPerformance
from slidax.law.error_transformations import PrescribedPerformance, Sides, psi
from slidax.law.reaching_laws import FixedTimeReaching, TwoPowerReaching
from slidax.law.sliding_mode_controllers import SlidingMode
from slidax.law.surfaces import LinearCoreFixedTime, SingularityFree, SmoothFixedTime, sliding_variable
from slidax.plant.actuators import TorqueLimits
from slidax.scenarios.scenario import Scenario

from ..certificate import Assumption, Status
from ..sampled_scenario import BatchedFunction, Floats
from ..uncertainty_set import start_box


@dataclass(frozen=True)
class PowerSurface:
    """Powers of the surface function, `φ(ε) = sgn(ε) (k1 |ε|^p + k2 |ε|^q)` for `|ε| >= δ`.

    ε is the transformed error. Each value is [n], one for each joint.

    - `k1`, `p`: gain and exponent of the power near zero.
    - `k2`, `q`: gain and exponent of the power far from zero.
    - `delta`: half width of the core, in which each surface (law/surfaces.py) has another function than `|ε|^p`.
    """

    k1: Floats
    p: Floats
    k2: Floats
    q: Floats
    delta: Floats


@dataclass(frozen=True)
class PrintedLaw:
    """A scenario's law in printed form, with the functions and parameters that its certificates need."""

    scenario: Scenario
    law: SlidingMode

    @classmethod
    def of(cls, scenario: Scenario) -> PrintedLaw | None:
        """Return the scenario's law; None if it is not in printed form."""
        law = scenario.controller
        return cls(scenario, law) if isinstance(law, SlidingMode) else None

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.law.joints

    @property
    def held(self) -> bool:
        """True if the torque is held over a period."""
        return self.scenario.stepping.mode == "held"

    @cached_property
    def performance(self) -> AbstractPerformance | None:
        """The function ρ(t), the envelope's radius; None for a law without an envelope."""
        transformation = self.law.transformation
        return transformation.performance if isinstance(transformation, PrescribedPerformance) else None

    @cached_property
    def sides(self) -> Sides | None:
        """Factors b and b̄ [n] of the envelope `bρ < e < b̄ρ`, by the error at the start; None without an envelope."""
        transformation = self.law.transformation
        if not isinstance(transformation, PrescribedPerformance):
            return None
        return transformation.init(jnp.zeros(()), jnp.asarray(self.start[0]))

    @cached_property
    def powers(self) -> PowerSurface | None:
        """The powers of the surface; None for a surface of another form."""
        surface, n = self.law.surface, self.joints
        if isinstance(surface, SmoothFixedTime | LinearCoreFixedTime):
            parts = surface.k1, surface.p, surface.k2, surface.q, surface.delta
        elif isinstance(surface, SingularityFree):
            parts = surface.c1, surface.alpha, surface.c2, surface.beta, surface.delta
        else:
            return None
        return PowerSurface(*(np.broadcast_to(np.asarray(value, float), n) for value in parts))

    @property
    def layer(self) -> float | None:
        """s0, the width of the boundary layer, rad/s or m/s; None for a reaching law without a term `s/(‖s‖ + s0)`."""
        reaching = self.law.reaching
        if not isinstance(reaching, FixedTimeReaching | TwoPowerReaching):
            return None
        return float(reaching.layer)

    @property
    def gain(self) -> tuple[Floats, float] | None:
        """K0 [n n] and r of the reaching law's term `K0 |s|^r sgn(s)`; None for a reaching law of another form."""
        reaching, n = self.law.reaching, self.joints
        if isinstance(reaching, FixedTimeReaching):
            gain, exponent = reaching.gain, float(reaching.exponent)
        elif isinstance(reaching, TwoPowerReaching):
            gain, exponent = reaching.k1, float(reaching.v1)
        else:
            return None
        array = np.asarray(gain, float)
        return (array if array.ndim == 2 else np.diag(np.broadcast_to(array, n))), exponent

    def phi(self, eps: Floats) -> Floats:
        """Return the surface function φ of each joint [values n], rad/s or m/s.

        - `eps`: transformed errors ε1, the same for all joints [values].
        """
        return self._surface(np.broadcast_to(np.asarray(eps, float)[:, None], (len(eps), self.joints)))[0]

    def slopes(self) -> Floats:
        """Return the slopes of φ at zero [n]."""
        return self._surface(np.zeros((1, self.joints)))[1][0]

    def phi_inverse(self, phi: float) -> Floats:
        """Return for each joint an upper bound of the ε with `φ(ε) = phi` [n], too large by at most a factor 1 + 2e-4.

        - `phi`: value of φ, rad/s or m/s; for `phi` <= 0 the result is 0.
        """
        if phi <= 0.0:
            return np.zeros(self.joints)
        reach = np.asarray(self.law.surface.reach(jnp.full(self.joints, phi)), float) * np.ones(self.joints)
        errors = np.zeros(self.joints)
        for joint in range(self.joints):
            low, high = 1e-12 * reach[joint], reach[joint] * (1.0 + 1e-12)
            for _ in range(2):
                grid = np.geomspace(low, high, GRID_POINTS)
                enough = self.phi(grid)[:, joint] >= phi
                k = int(np.argmax(enough)) if enough.any() else GRID_POINTS - 1
                low, high = grid[max(k - 1, 0)], grid[k]
            errors[joint] = high
        return errors

    def radius(self, t: Floats) -> Floats:
        """Return ρ(t) [times n] at times t [times], s; 1 without an envelope."""
        if self.performance is None:
            return np.ones((len(t), self.joints))
        return np.broadcast_to(self._radius(t)[0].reshape(len(t), -1), (len(t), self.joints))

    def psi(self, eps: Floats) -> Floats:
        """Return `ψ(ε)` [values n] of transformed errors [values n]; ε itself without an envelope."""
        return np.asarray(eps, float) if self.sides is None else self._psi(eps)[0]

    @cached_property
    def start(self) -> tuple[Floats, Floats, Floats]:
        """Error e, sliding variable s and transformed error ε1 at t = 0, each [n].

        s and ε1 are not finite for a start outside the envelope.
        """
        scenario, law = self.scenario, self.law

        def at(t: Any, q: Any, dq: Any) -> Any:
            reference, state = scenario.trajectory.reference(t), State(q=q, dq=dq)
            memory = law.init(t, state, reference)
            sliding = sliding_variable(law.transformation, law.surface, t, state, reference, memory)
            return q - reference.q, sliding.s, sliding.error.eps1

        e, s, eps = BatchedFunction(at)([0.0], [scenario.state0.q], [scenario.state0.dq])
        return e[0], s[0], eps[0]

    @cached_property
    def _surface(self) -> BatchedFunction:
        return BatchedFunction(self.law.surface.phi_and_slope)

    @cached_property
    def _radius(self) -> BatchedFunction:
        performance = self.performance
        assert performance is not None
        return BatchedFunction(performance.radius)

    @cached_property
    def _psi(self) -> BatchedFunction:
        sides = self.sides
        assert sides is not None
        return BatchedFunction(lambda eps: psi(eps, sides))

    def nominal_variation(self) -> float:
        """Return the largest change of the nominal inertia matrix M0 from one random posture to 63 others.

        It is relative to the largest entry of M0 in the first posture.
        """
        masses = masses_at(self.law.nominal, np.random.default_rng(0).uniform(-3, 3, (64, self.joints)))
        return float(np.max(np.abs(masses - masses[0])) / np.max(np.abs(masses[0])))

    @property
    def gain_is_diagonal(self) -> bool:
        """True if K0 is diagonal and positive definite."""
        if self.gain is None:
            return False
        k0, _ = self.gain
        return bool(np.all(k0 == np.diag(np.diag(k0)))) and is_positive_definite(k0)


GRID_POINTS = 400
"""Number of grid points for the inverse of the surface function."""


def masses_at(robot: AbstractRobot, q: Floats) -> Floats:
    """Return `M(q)` at several positions [positions n n]."""
    return inertia_and_bias(robot, np.asarray(q, float), np.zeros_like(q))[0]


def drive_delays(scenario: Scenario) -> str:
    """Return the delays of a scenario's drives in words, such as "`actuator.dead_time`"; empty without one."""
    drives = scenario.description.actuator
    delays = {"dead_time": drives.dead_time, "time_constant": np.any(np.asarray(drives.time_constant) != 0.0)}
    return " and ".join(f"`actuator.{name}`" for name, present in delays.items() if present)


def continuous_premises(printed: PrintedLaw, *, unit_vector: bool = True) -> tuple[Assumption, ...]:
    """Return the assumptions of continuous time, exact measurements, unlimited torque and a start in the envelope.

    - `unit_vector`: True to require the unit vector of the paper's (44), for a certificate that does not hold with the
      boundary layer of (51).
    """
    scenario, plant = printed.scenario, printed.scenario.plant
    own = getattr(plant, "own", plant)
    assumptions = []
    if unit_vector:
        layer = printed.layer
        text = "the unit vector is that of the paper's (44)"
        if layer != 0.0:
            text += "; the scheme has no such vector" if layer is None else f"; here its layer is s0 = {layer:.3g} (51)"
        assumptions.append(Assumption(text, "proved" if layer == 0.0 else "fails", layer))
    if printed.held:
        text = f"the torque follows the state at once; here it is held for {1e3 * scenario.period:.3g} ms"
        assumptions.append(Assumption(text, "fails", scenario.period))
    else:
        assumptions.append(Assumption("the torque follows the state at once: simulation.mode is continuous", "proved"))
    if own.sensor is not None:
        assumptions.append(
            Assumption("positions and velocities are measured exactly; the scenario has a sensor", "fails")
        )
    delays = drive_delays(scenario)
    if delays:
        assumptions.append(Assumption(f"the drives deliver the torque at once; the scenario has {delays}", "fails"))
    limits: TorqueLimits | None = None if own.actuator is None else getattr(own.actuator, "limits", None)
    if limits is None or all(np.isinf(np.asarray(most)).all() for most in (limits.torque, limits.rate)):
        assumptions.append(Assumption("the drives deliver any torque: no limit is given", "assumed"))
    else:
        assumptions.append(Assumption("the torque stays within the drives' limits, see `torque_budget`", "assumed"))
    if printed.performance is not None:
        starts = start_box(scenario)
        reference = np.asarray(scenario.state0.q) - printed.start[0]
        error = np.maximum(np.abs(starts.lower - reference), np.abs(starts.upper - reference))
        share = np.max(error / printed.radius(np.zeros(1))[0])
        status: Status = "proved" if share < 1.0 else "fails"
        assumptions.append(Assumption(f"{starts.all_are} inside the envelope, |e(0)| < ρ0", status, float(share)))
    return tuple(assumptions)
