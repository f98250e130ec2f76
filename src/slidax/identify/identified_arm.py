"""The identified arm: parameters with standard errors, and the prediction of each log."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import numpy as np
from scipy import stats

from slidax.arms.arm import Payload
from slidax.arms.articulated import PAIRS, Articulated
from slidax.core.errors import DefinitionError, as_array

from .band import Band, EstimateErrors, band_of
from .logs import JointLog
from .regression import ParameterFit
from .regressor import BODY, body_of_parameters
from .unknowns import REACH, TILT, Unknowns


@dataclass(frozen=True)
class EstimatedParameter:
    """An estimated parameter of an arm.

    - `name`: such as `armature` or `payload.mass`.
    - `joint`: name of its joint; empty if it belongs to no joint.
    - `path`: its key in a robot's description; empty if the description has no such key.
    - `unit`: unit of the value.
    - `value`: the estimate.
    - `standard_error`: standard error of the value.
    - `prior_error`: standard deviation of the parameter's prior.
    """

    name: str
    joint: str
    path: str
    unit: str
    value: float
    standard_error: float
    prior_error: float

    @property
    def identifiable(self) -> bool:
        """True if the standard error is less than a tenth of the prior's standard deviation."""
        return self.standard_error < IDENTIFIABLE * self.prior_error

    @property
    def is_poorly_seen(self) -> bool:
        """True if the standard error is between a tenth and half of the prior's standard deviation."""
        return not self.identifiable and self.standard_error < HIDDEN * self.prior_error

    @property
    def label(self) -> str:
        """Name and joint: `armature of panda_joint1`."""
        return f"{self.name} of {self.joint}" if self.joint else self.name

    def as_text(self) -> tuple[str, str]:
        """Return the value and half the width of its 95 % interval, rounded to the width's second significant digit."""
        low, high = self.interval()
        half = float(f"{0.5 * (high - low):.1e}")
        if not 1e-7 <= half < np.inf:
            return f"{self.value:.4g}", f"{half:.2g}"
        places = max(0, 1 - math.floor(math.log10(half)))
        # Adding zero takes the sign from a zero.
        return f"{round(self.value, places) + 0.0:.{places}f}", f"{half:.{places}f}"

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return both ends of a confidence interval for the true value, if the model has the right form.

        - `confidence`: confidence in (0, 1).
        """
        half = float(stats.norm.ppf(0.5 + 0.5 * confidence)) * self.standard_error
        return self.value - half, self.value + half


@dataclass(frozen=True, eq=False)
class LogFit:
    """A log, and the prediction of its torques by the identified arm.

    - `log`: the log that was fitted.
    - `cut_off`: cut-off frequency of the low-pass filter that torques and prediction pass [Hz].
    - `lag`, `lag_error`: delay of the torques after the positions, and its standard error [s].
    - `t`, `measured`, `predicted`: times [k], and filtered torques [k n], N m or N.
    - `split`: first row of the held-out part, which is predicted and not fitted.
    - `fit_rms`, `held_out_rms`: root mean square of the filtered prediction error in the two parts [n], N m or N.
    - `measured_rms`: root mean square of the filtered measured torque [n], N m or N.
    """

    log: JointLog
    cut_off: float
    lag: float
    lag_error: float
    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    split: int
    fit_rms: np.ndarray
    held_out_rms: np.ndarray
    measured_rms: np.ndarray

    def as_json(self) -> dict[str, Any]:
        """An entry of `logs` in the output of `slidax identify --json`."""
        return {
            "source": self.log.source,
            "samples": len(self.log.t),
            "cut_off": self.cut_off,
            "lag": {"value": self.lag, "standard_error": self.lag_error},
            "torque_rms": {"fit": self.fit_rms.tolist(), "held_out": self.held_out_rms.tolist()},
        }


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of identification: the arm, its parameters with standard errors, and the prediction errors.

    - `robot`: the arm with identified rotors, friction, payload and links.
    - `parameters`: each estimated parameter with its standard error.
    - `logs`: each log with its prediction.
    - `condition`: condition number of the logs' information matrix in units of the prior's standard deviations.
    - `unseen_directions`: number of eigenvalues < 1 of this matrix: parameter combinations that the logs determine less
      closely than the prior.
    - `warnings`: sentences on the logs, and on parameters that they determine poorly.
    - `seconds`: computing time.
    - `estimate`: the estimate of the unknown parameters, and the covariance of its errors.
    """

    robot: Articulated
    parameters: tuple[EstimatedParameter, ...]
    logs: tuple[LogFit, ...]
    condition: float
    unseen_directions: int
    warnings: tuple[str, ...]
    seconds: float
    estimate: EstimateErrors

    @property
    def source(self) -> str:
        """Names of the logs."""
        return " and ".join(fit.log.source for fit in self.logs)

    @property
    def fit_rms(self) -> np.ndarray:
        """Root mean square of the prediction error in the fitted parts, over all logs [n], N m or N."""
        return self._rms("fit_rms")

    @property
    def held_out_rms(self) -> np.ndarray:
        """As `fit_rms`, in the held-out parts [n]."""
        return self._rms("held_out_rms")

    @property
    def measured_rms(self) -> np.ndarray:
        """Root mean square of the measured torques, over all logs [n], N m or N."""
        return self._rms("measured_rms")

    def _rms(self, name: str) -> np.ndarray:
        # For a single log, the square root of the square is exactly the log's own value.
        return np.asarray(np.sqrt(np.mean([getattr(fit, name) ** 2 for fit in self.logs], axis=0)))

    @cached_property
    def band(self) -> Band | None:
        """Confidence region of the true arm; None if none can be proved, since some body has no inertia."""
        try:
            return band_of(self.robot, self.estimate)
        except DefinitionError:
            return None

    @cached_property
    def actuator_map(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The map G from the log's torques to the joints' torques, `τ = G τ_log`, and its standard errors, both [n n].

        None if G is not identified.
        """
        if "gain" not in self.estimate.names:
            return None
        values, errors = np.zeros((2, self.robot.joints, self.robot.joints))
        deviations = np.sqrt(np.diag(self.estimate.covariance))
        for name, joint, value, error in zip(
            self.estimate.names, self.estimate.joints, self.estimate.theta, deviations, strict=True
        ):
            kind, _, other = name.partition("_")
            if kind in ("gain", "crosstalk"):
                column = int(other) if other else joint
                values[joint, column], errors[joint, column] = value, error
        return values, errors

    @property
    def unseen(self) -> tuple[EstimatedParameter, ...]:
        """The parameters that are not `identifiable` from the logs."""
        return tuple(parameter for parameter in self.parameters if not parameter.identifiable)

    def values(self, name: str) -> np.ndarray:
        """Return the values of a parameter for all joints, in the arm's order.

        - `name`: such as `armature`.
        """
        return np.array([parameter.value for parameter in self.parameters if parameter.name == name])

    def standard_errors(self, name: str) -> np.ndarray:
        """Return the standard errors of a parameter for all joints, in the arm's order.

        - `name`: such as `armature`.
        """
        return np.array([parameter.standard_error for parameter in self.parameters if parameter.name == name])

    def as_json(self) -> dict[str, Any]:
        """The output of `slidax identify --json`."""
        return {
            "parameters": [
                {
                    "name": parameter.name,
                    "joint": parameter.joint or None,
                    "path": parameter.path or None,
                    "unit": parameter.unit,
                    "value": parameter.value,
                    "standard_error": parameter.standard_error,
                    "seen": parameter.identifiable,
                }
                for parameter in self.parameters
            ],
            "band": self.band and self.band.as_json(),
            "torque_rms": {"fit": self.fit_rms.tolist(), "held_out": self.held_out_rms.tolist()},
            "measured_rms": self.measured_rms.tolist(),
            "warnings": list(self.warnings),
            "condition": self.condition,
            "unseen_directions": self.unseen_directions,
            "logs": [fit.as_json() for fit in self.logs],
        }

    def __str__(self) -> str:
        these = "this log" if len(self.logs) == 1 else "these logs"
        width = max(len(parameter.label) for parameter in self.parameters)
        lines = [
            f"{self.robot.name} from {fit.log.source}: {len(fit.log.t)} samples, low-pass filter {fit.cut_off:.3g} Hz"
            for fit in self.logs
        ]
        for parameter in self.parameters:
            value, half = parameter.as_text()
            end = "" if parameter.identifiable else f"  {'poorly' if parameter.is_poorly_seen else 'not'} seen"
            lines.append(f"{parameter.label:<{width}}  {value:>10} ± {half:<8} {parameter.unit}{end}")
        units = ", ".join(dict.fromkeys("N m" if unit == "rad" else "N" for unit in self.robot.joint_units))
        lines.append(f"root mean square of the torques [{units}], joint by joint:")
        lines.append(f"measured      {_listed(self.measured_rms)}")
        lines.append(f"error of fit  {_listed(self.fit_rms)}")
        lines.append(f"held out      {_listed(self.held_out_rms)}")
        lines.append(str(self.band) if self.band else "no band: some body of the arm has no mass or no inertia")
        lines += [f"warning: {sentence}" for sentence in self.warnings]
        if self.unseen_directions:
            lines.append(f"{self.unseen_directions} combinations of these parameters do not show in {these}")
        return "\n".join(lines)

    __repr__ = __str__


def _listed(values: np.ndarray) -> str:
    return " ".join(f"{value:8.3g}" for value in values)


IDENTIFIABLE, HIDDEN = 0.1, 0.5
"""Two limits of a parameter's standard error, as shares of its prior standard deviation.

Below the first limit the parameter is identifiable. Below the second one it is seen poorly, above it not at all.
"""

UNITS = {
    "armature": ("kg m²", "kg"),
    "coulomb": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "asymmetry": ("N m s/rad", "N s/m"),
    **dict.fromkeys(("offset", "stribeck", "ripple"), ("N m", "N")),
    "encoder": ("rad", "m"),
    **dict.fromkeys(("gain", "crosstalk"), ("", "")),
}
"""Units of a drive's parameters, for a revolute and for a prismatic joint; `ripple_30_cos` is a `ripple`."""

PATHS = {
    "armature": "nominal.armature",
    "coulomb": "plant.coulomb",
    "viscous": "nominal.viscous",
    "encoder_offset": "nominal.zero",
}
"""Keys of drive parameters in a robot's description."""

BODY_PARAMETERS = (
    ("mass", "kg", "mass"),
    *((f"center.{axis}", "m", f"center.{i}") for i, axis in enumerate("xyz")),
    *((f"inertia.{pair}", "kg m²", f"inertia.{i}") for i, pair in enumerate(("xx", "yy", "zz", "xy", "xz", "yz"))),
)
"""A body's parameters: name, unit, and key in the robot's description."""


def identified_robot(robot: Articulated, unknowns: Unknowns, theta: np.ndarray) -> Articulated:
    """Return the arm with its identified parameters.

    - `robot`: the arm before identification.
    - `unknowns`: the fitted equation, with the names of its parameters θ.
    - `theta`: the identified parameters.
    """
    changes: dict[str, Any] = {}
    for name in ("armature", "coulomb", "viscous"):
        values = theta[[i for i, other in enumerate(unknowns.names) if other == name]]
        if len(values):
            changes[name] = as_array(np.maximum(values, 0.0))
    links = []
    for start in unknowns.bodies:
        mass, center, inertia = body_of_parameters(theta[start : start + BODY])
        if unknowns.names[start].startswith("load_"):
            continue  # The load of a log is not part of the arm.
        if unknowns.joints[start] < 0:
            changes["payload"] = Payload(mass=as_array(mass), center=as_array(center), inertia=as_array(inertia))
        else:
            links.append((mass, center, inertia))
    if links:
        masses, centers, inertias = (np.array(values) for values in zip(*links, strict=True))
        changes |= {"masses": as_array(masses), "centers": as_array(centers), "inertias": as_array(inertias)}
    names = list(changes)
    return eqx.tree_at(lambda arm: [getattr(arm, name) for name in names], robot, [changes[name] for name in names])


def estimates_of(
    robot: Articulated, unknowns: Unknowns, fitted: ParameterFit, theta: np.ndarray
) -> tuple[EstimatedParameter, ...]:
    """Return each parameter with its standard error and the standard deviation of its prior.

    - `robot`: the arm before identification.
    - `unknowns`: the fitted equation, with the names and priors of its parameters θ.
    - `fitted`: the unconstrained fit, which has the covariance.
    - `theta`: the physically consistent parameters.
    """
    listed: list[EstimatedParameter] = []
    inside = np.zeros(len(theta), bool)
    for number, start in enumerate(unknowns.bodies):
        own = slice(start, start + BODY)
        inside[own] = True
        listed += _body_estimates(
            robot, unknowns.joints[start], number, theta[own], fitted.covariance[own, own], unknowns, own
        )
    errors = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    for i in np.nonzero(~inside)[0]:
        name, joint = unknowns.names[i], unknowns.joints[i]
        if name == "gravity":
            continue
        listed.append(
            EstimatedParameter(
                name=name,
                joint=robot.joint_names[joint],
                path=f"{PATHS[name]}.{joint}" if name in PATHS else "",
                unit=UNITS[name.partition("_")[0]][robot.joint_units[joint] == "m"],
                value=float(theta[i]),
                standard_error=float(errors[i]),
                prior_error=float(unknowns.scale[i]),
            )
        )
    return tuple(listed)


def _body_estimates(
    robot: Articulated,
    joint: int,
    number: int,
    phi: np.ndarray,
    covariance: np.ndarray,
    unknowns: Unknowns,
    own: slice,
) -> list[EstimatedParameter]:
    """Return a body's mass, centre and inertia about the centre, with errors propagated from φ to first order."""
    values = _center_parameters(phi)
    sizes = unknowns.scale[own]
    slopes = np.empty((BODY, BODY))
    for i in range(BODY):
        step = 1e-6 * sizes[i]
        slopes[:, i] = (
            _center_parameters(phi + step * np.eye(BODY)[i]) - _center_parameters(phi - step * np.eye(BODY)[i])
        ) / (2.0 * step)
    errors = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    mass = max(values[0], 1e-9)
    # The prior scale of centre and inertia follows the identified mass.
    believed = np.array([sizes[0], *3 * (REACH,), *6 * (mass * REACH**2,)])
    body = unknowns.names[own][0].partition(".")[0]
    section = {"payload": "nominal.load", "link": "nominal.links"}.get(body, "")
    listed = []
    for i, (name, unit, path) in enumerate(BODY_PARAMETERS):
        kind, _, entry = path.partition(".")
        within = f".{number}" if joint >= 0 else ""
        listed.append(
            EstimatedParameter(
                name=f"{body}.{name}",
                joint="" if joint < 0 else robot.joint_names[joint],
                path=section and f"{section}.{kind}{within}{'.' if entry else ''}{entry}",
                unit=unit,
                value=float(values[i]),
                standard_error=float(errors[i]),
                prior_error=float(believed[i]),
            )
        )
    return listed


def gravity_estimates(robot: Articulated, axes: np.ndarray, covariance: np.ndarray) -> tuple[EstimatedParameter, ...]:
    """Return the components of the identified gravity vector in the base frame, with their standard errors.

    - `robot`: the identified arm.
    - `axes`: change of gravity per rad of rotation about each of two axes [3 2].
    - `covariance`: covariance of the two rotation angles [2 2], rad².
    """
    gravity = np.asarray(robot.gravity_vector)
    size = float(np.linalg.norm(gravity))
    # Along gravity itself, the change is of second order in the angles.
    along = 0.5 * float(np.sum(covariance**2))
    errors = np.sqrt(np.diag(axes @ covariance @ axes.T) + along * gravity**2)
    return tuple(
        EstimatedParameter(
            name=f"gravity.{axis}",
            joint="",
            path=f"nominal.gravity.{i}",
            unit="m/s²",
            value=float(gravity[i]),
            standard_error=float(errors[i]),
            prior_error=TILT * size,
        )
        for i, axis in enumerate("xyz")
    )


def _center_parameters(phi: np.ndarray) -> np.ndarray:
    """Return a body's mass, centre and inertia about the centre, [10], from its inertial parameters φ [10]."""
    mass = phi[0] if abs(phi[0]) > 1e-9 else 1e-9
    _, center, inertia = body_of_parameters(np.array([abs(mass), *np.sign(mass) * phi[1:]]))
    return np.array([mass, *center, *(np.sign(mass) * inertia[pair] for pair in PAIRS)])
