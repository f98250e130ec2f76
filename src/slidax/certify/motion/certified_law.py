"""A scenario's law, true arm, sensors and drives, as `tracking_bound` needs them.

Scenarios outside the bound's scope are refused here, with a remedy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.law.sampled.controller import SampledData
from slidax.law.sampled.gate import MeasurementGate
from slidax.plant.sensors import AbstractSensor, Delayed, DifferencedEncoders, Encoders, Exact, Lossy
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import INERTIAL_PATH, InertialBand
from slidax.simulation.plant import Plant

from ..certificate import Assumption
from ..uncertainty_set import family_of, set_ends
from .body_points import BodyPoints
from .hand_over import HandOver
from .joint_loop import JointLoop
from .parameter_region import BodyBand, ParameterRegion, ball_region, joined_regions
from .parameter_sets import numbers_regions, rigid_links
from .tracking_bound import WIDEST, ArmUncertainty

Floats = NDArray[np.float64]

ROUNDING = 1e-9
"""rad/s or m/s: velocities up to this size are attributed to rounding."""

SIGMAS = 6.0
"""The encoders' normal noise is assumed to stay within this number of standard deviations."""


@dataclass(frozen=True, eq=False)
class CertifiedLaw:
    """A law to certify along motions, with its arm, uncertainty and limits: everything but the motion.

    - `arm`: the nominal arm; `bodies`: its bodies as points with mass (body_points.py).
    - `loop`: linear loop of every joint.
    - `uncertainty`: uncertainty of the true arm.
    - `gate`: the law's measurement gate, which rejects implausible positions.
    - `torque`, `torque_rate`: the smaller of the drives' and the law's limits [n], N m or N, and N m/s or N/s.
    - `premises`: assumptions that the certificate does not prove.
    - `hand_over`: nonlinear part of a law with a sliding surface (hand_over.py); None for computed torque.
    """

    arm: Articulated
    bodies: BodyPoints
    loop: JointLoop
    uncertainty: ArmUncertainty
    gate: MeasurementGate
    torque: Floats
    torque_rate: Floats
    premises: tuple[Assumption, ...]
    hand_over: HandOver | None = None

    @classmethod
    def of(cls, scenario: Scenario) -> CertifiedLaw:
        """Return the law of a scenario, with its true arm and its block `uncertainty`.

        Raises DefinitionError for a scenario outside the bound's scope; the message names the setting and a remedy.
        """
        law = scenario.controller
        if not isinstance(law, SampledData):
            raise DefinitionError(
                "a bound along a motion needs a law in sampled-data form: set `scheme.sampled_data` and "
                "`simulation.mode: held`"
            )
        loop, arm = JointLoop.of(law), rigid_links(law.nominal)
        ends = _ends(scenario)
        plants, robots = [plant for plant, _, _ in ends], [robot for _, robot, _ in ends]
        for name in ("rotations", "translations", "gravity_vector"):
            if any(np.any(np.asarray(getattr(each, name)) != np.asarray(getattr(arm, name))) for each in robots):
                raise DefinitionError(
                    "a bound along a motion needs a true arm with the joints and the gravity of the nominal one: set "
                    "`robot.nominal.lengths` and `robot.nominal.gravity_acceleration` to those under `robot.plant`"
                )
        bodies = BodyPoints.of(arm)
        resolution, premises = _encoders(plants[0].sensor, law)
        torque, rate = _drives(plants, law)
        start_error, start_speed = _start(scenario, [state for _, _, state in ends])
        far = int(np.argmax(start_error))
        if start_error[far] > WIDEST:
            raise DefinitionError(
                f"the arm starts up to {start_error[far]:.3g} {arm.joint_units[far]} from its motion in "
                f"`{arm.joint_names[far]}`, and a bound needs a start within {WIDEST:g}: set `start.q` nearer to the "
                "motion, or test the scenario in runs (`statistical`)"
            )
        speed = np.asarray(scenario.trajectory.reference(jnp.zeros(())).dq, float)
        if np.any(start_speed > ROUNDING):
            raise DefinitionError(
                f"a bound along a motion needs a start with the motion's velocity: set `start.dq` to {speed.tolist()}"
            )
        differenced = isinstance(_behind_delay(plants[0].sensor), DifferencedEncoders)
        if differenced and np.any(np.abs(speed) > ROUNDING):
            premises = (*premises, Assumption("the arm's velocity at the start is known", "assumed"))
        uncertainty = ArmUncertainty(
            _region(scenario, arm, bodies, plants[0]),
            coulomb=np.maximum(*(np.asarray(robot.coulomb, float) for robot in robots)),
            viscous_error=np.maximum(
                *(np.abs(np.asarray(robot.viscous, float) - np.asarray(arm.viscous)) for robot in robots)
            ),
            torque=_disturbance(plants, arm.joints),
            resolution=resolution,
            start_error=start_error,
            start_speed=start_speed,
        )
        return cls(arm, bodies, loop, uncertainty, law.gate, torque, rate, premises, HandOver.of(law))


def _ends(scenario: Scenario) -> list[tuple[Plant, Articulated, Any]]:
    """Return two triples of plant, true arm and start: for the least and for the largest value of each uncertain path.

    The inertial band is left out.
    """
    family = family_of(scenario)
    sets = {} if family is None else {k: each for k, each in family.space.sets.items() if k != INERTIAL_PATH}
    both = []
    for side in range(2):
        plant, state = scenario.plant, scenario.state0
        if family is not None and sets:
            values = {path: set_ends(each, family.space.leaves[path])[side] for path, each in sets.items()}
            moving = family.case(values).as_it_is().moving()
            plant, state = moving.plant, moving.state0
        if not isinstance(plant, Plant):
            raise DefinitionError("a bound along a motion needs slidax's own plant: leave out `simulation.mujoco`")
        both.append((plant, rigid_links(plant.robot), state))
    return both


def _region(scenario: Scenario, arm: Articulated, bodies: BodyPoints, plant: Plant) -> ParameterRegion:
    """Return the region of the true arm's inertial parameters."""
    family = family_of(scenario)
    band = None if family is None else family.space.sets.get(INERTIAL_PATH)
    regions = []
    if isinstance(band, InertialBand):
        if band.deviations is None:
            regions.append(BodyBand(band.band, band.band).region(bodies))
        else:
            rows, confidence = np.asarray(band.deviations, float), band.confidence or 1.0
            title = f"the band of the identified arm, p = {100 * band.band:.2g} % ({100 * confidence:g} % confidence)"
            regions.append(ball_region(arm, rows, band.band, title))
    regions += numbers_regions(scenario, arm, plant)
    return joined_regions(regions) if regions else BodyBand(0.0, 0.0).region(bodies)


def _disturbance(plants: list[Plant], joints: int) -> Floats:
    size = plants[0].disturbance.largest(plants[1].disturbance, joints)
    if not np.all(np.isfinite(size)):
        raise DefinitionError(
            "a bound along a motion needs disturbances of bounded torque: describe friction under `robot.plant`, and "
            "leave out contacts"
        )
    return np.asarray(size, float)


def _behind_delay(sensor: AbstractSensor | None) -> AbstractSensor | None:
    return sensor.sensor if isinstance(sensor, Delayed) else sensor


def _encoders(sensor: AbstractSensor | None, law: SampledData) -> tuple[Floats, tuple[Assumption, ...]]:
    """Return the encoders' resolution plus the range of their noise, peak to peak [n], and the assumption about it."""
    delay = 0.0
    if isinstance(sensor, Lossy):
        raise DefinitionError("a bound along a motion needs every sample: leave out `sensor.loss`")
    if isinstance(sensor, Delayed):
        if sensor.jitter:
            raise DefinitionError("a bound along a motion needs a constant measurement delay: set `sensor.jitter: 0`")
        delay, sensor = float(sensor.periods), sensor.sensor
    if delay != law.believed_delay:
        raise DefinitionError(
            f"the measurement delay is {delay:g} periods, but the law assumes {law.believed_delay:g}: leave out "
            "`scheme.sampled_data.delay`"
        )
    if sensor is None or isinstance(sensor, Exact):
        return np.zeros(law.joints), ()
    if not isinstance(sensor, Encoders | DifferencedEncoders):
        raise DefinitionError(
            f"a bound along a motion covers encoders; got `{type(sensor).__name__}`: leave out `sensor.instrument`"
        )
    if isinstance(sensor, Encoders) and np.any(np.asarray(sensor.velocity_noise)):
        raise DefinitionError(
            "a bound along a motion needs a velocity without noise at the first sample: set "
            "`sensor.velocity: differenced`; the Kalman filter uses the measured velocity only at that sample"
        )
    noise = np.broadcast_to(np.asarray(sensor.position_noise, float), law.joints)
    resolution = np.broadcast_to(np.asarray(sensor.resolution, float), law.joints) + 2.0 * SIGMAS * noise
    if not noise.any():
        return resolution, ()
    return resolution, (Assumption(f"no position's noise exceeds {SIGMAS:g} standard deviations", "assumed"),)


def _drives(plants: list[Plant], law: SampledData) -> tuple[Floats, Floats]:
    """Return the limits of torque and torque rate [n]: the smaller of the drives' and the law's."""
    torque, rate = (np.broadcast_to(np.asarray(getattr(law.limits, name)), law.joints) for name in ("torque", "rate"))
    for plant in plants:
        actuator = plant.actuator
        if actuator is None:
            continue
        if np.any(np.asarray(actuator.time_constant)) or actuator.dead_time:
            raise DefinitionError(
                "a bound along a motion needs drives without lag: set `actuator.time_constant: 0` and "
                "`actuator.dead_time: 0`, and add their delay to `sensor.delay`"
            )
        if actuator.map is not None:
            raise DefinitionError("a bound along a motion needs drives without a map: leave `actuator.map` out")
        torque = np.minimum(torque, np.asarray(actuator.limits.torque))
        rate = np.minimum(rate, np.asarray(actuator.limits.rate))
    return torque, rate


def _start(scenario: Scenario, states: list[Any]) -> tuple[Floats, Floats]:
    """Return the largest |e| and |ė| at the start [n]."""
    reference = scenario.trajectory.reference(jnp.zeros(()))
    errors = [np.abs(np.asarray(state.q - reference.q, float)) for state in states]
    speeds = [np.abs(np.asarray(state.dq - reference.dq, float)) for state in states]
    return np.maximum(*errors), np.maximum(*speeds)
