"""The certificate `printed_period`: the longest period over which the printed law's torque may be held."""

from __future__ import annotations

import numpy as np

from slidax._types import State
from slidax.diagnosis import Remedy
from slidax.reaching import TwoPowerReaching
from slidax.scenarios import Scenario

from ..certificate import ARM, WORLD, certificate
from ..corners import members_of
from ..each import Each
from ..envelope import SampledReference
from ..verdict import Assumption, Verdict
from .law import PrintedLaw

PRINTED_PERIOD = "printed_period", "stable at its period"

SAFE = 0.95
"""Share of the limit. Between this share and the limit a loop is stable, but its eigenvalue near -1 makes torque steps
grow, in runs of the paper's examples 20-fold within 2 % (docs/certificates/paper.md).
"""


@certificate(*PRINTED_PERIOD, covers=ARM, reads=(*WORLD, "scheme", "simulation"))
def printed_period(scenario: Scenario) -> Verdict:
    """Check `h < 2/λmax(M⁻¹ (M0 Λ + (u/s0) I))`: the printed law near its goal, held over a period.

    Near e = 0 the law is `τ = -(M0 Λ + (u/s0) I) ė - ...` with Λ = slope(0) β. A sampled double integrator with that
    damping has an eigenvalue at -1 exactly where `h M⁻¹ (M0 Λ + (u/s0) I)` has one at 2. The surface alone has the
    limit `2/λmax(M⁻¹ M0 Λ)`, the layer alone `2 s0 λmin(M)/u`.

    Bounds: `period`, with some distance from the limit; `limit`, `surface`, `layer` as above, s.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        return Verdict(*PRINTED_PERIOD, None, None, {}, (), "it applies only to a law in printed form")
    if layer == 0.0 or isinstance(printed.law.reaching, TwoPowerReaching):
        limits = {"period": 0.0, "limit": 0.0, "surface": _limits(printed, scenario, np.inf)[1], "layer": 0.0}
    else:
        each = [_limits(printed, member, layer) for member in members_of(scenario)]
        limit, surface, edge = map(min, zip(*each, strict=True))
        limits = {"period": SAFE * limit, "limit": limit, "surface": surface, "layer": edge}
    limit, period = limits["period"], scenario.period
    claim = f"With the torque held for less than {1e3 * limit:.3g} ms the loop is stable and smooth near its goal"
    if limit == 0.0:
        claim = "A unit vector without a layer chatters at every period"
    if not printed.held:
        text = f"{claim}; this scenario's torque follows the state at once, its period is the integrator's step."
        return Verdict(*PRINTED_PERIOD, None, None, limits, (), text)
    cases = len(members_of(scenario)) - 1
    over = f", for the scenario and {cases} corners of its uncertain set" if cases else ""
    assumptions = (
        Assumption("the loop is linear near its goal: e and s are small against ρ∞, δ and s0", "assumed"),
        Assumption(
            f"M, M0 and u along the reference, at {len(SampledReference(scenario).times)} times{over}", "tested"
        ),
    )
    holds = period < limit
    statement = f"{claim}: h < {SAFE:g} · 2/λmax(M⁻¹ (M0 Λ + (u/s0) I)); its period is {1e3 * period:.3g} ms."
    margin = 1.0 - period / limit if limit > 0.0 else -1.0
    remedies = [Remedy("the law in its sampled-data form", {"scheme.sampled_data": {}})]
    if limit > 0.0:
        remedies.insert(0, Remedy("a shorter period", {"simulation.period": float(f"{0.95 * limit:.2g}")}))
    return Verdict(*PRINTED_PERIOD, holds, margin, limits, assumptions, statement, () if holds else remedies)


def _limits(printed: PrintedLaw, member: Scenario, layer: float) -> tuple[float, float, float]:
    """The limits of surface and layer together, of the surface and of the layer, s."""
    law, motion, n = printed.law, SampledReference(member), printed.joints
    mass, (mass0, bias0) = motion.truth[0], motion.of_arm(law.nominal)
    steep = np.ones(n)
    if printed.sides is not None:
        steep = 1.0 / -np.asarray(printed.sides.lower) + 1.0 / np.asarray(printed.sides.upper)
    rate = printed.slopes() * steep / printed.radius(motion.times)
    q, dq, ddq = motion.states
    feedforward = np.einsum("kij,kj->ki", mass0, ddq) + bias0
    u = Each(lambda q, dq, tau: law.bound(State(q=q, dq=dq), tau))(q, dq, feedforward)[0].reshape(-1)
    surface = np.linalg.solve(mass, mass0 * rate[:, None, :])
    edge = np.linalg.inv(mass) * (u / layer)[:, None, None]
    return _period(surface + edge), _period(surface), _period(edge)


def _period(matrices: np.ndarray) -> float:
    if not np.all(np.isfinite(matrices)):
        # The products of gains or torques overflow: no period is short enough.
        return 2.0 / float(np.finfo(float).max)
    return 2.0 / max(float(np.max(np.abs(np.linalg.eigvals(matrices)))), 1e-300)
