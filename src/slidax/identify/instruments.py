"""Offsets of the encoders and the map of the actuators, as further unknowns of the arm's equation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, as_array

from .regression import ParameterFit, Unknowns
from .regressor import BODY, JointMotion, parameters_of_links, parameters_of_payload, rigid_torque
from .signals import LogSignals

OFFSET = {"rad": 0.1, "m": 0.05}
"""Prior standard deviation of an encoder's offset."""

GAIN, CROSSTALK = 0.3, 0.1
"""Prior standard deviations of a relative error of a gain, and of cross-talk."""

STRANGE = 0.6
"""Largest entry of an inverse map minus the identity; beyond, torques are in other units, signs or joint order."""

MAPS = ("gain", "full")
"""Forms of an actuator map: a gain for each joint, or all entries."""

STEP = 1e-4
"""Step of the positions for derivatives [rad or m]."""


@dataclass(frozen=True, eq=False)
class Instruments:
    """Offsets of encoders, and errors of the torques, about which the equation is linearised.

    - `offset`: true positions minus measured ones [n], rad or m; None if they are not unknown.
    - `error`: E with `τ_log = (1 + E) τ` for the joints' torques τ [n n]; None if it is not unknown.
    - `full`: True if all entries of E are unknown, False for those of its diagonal.
    """

    offset: np.ndarray | None
    error: np.ndarray | None
    full: bool

    @classmethod
    def started(cls, joints: int, encoder_offset: bool, actuator_map: str | None) -> Instruments:
        """Instruments without errors.

        - `encoder_offset`: True if offsets are unknown.
        - `actuator_map`: None, `gain` or `full`.

        Raises DefinitionError for another form of the map.
        """
        if actuator_map is not None and actuator_map not in MAPS:
            raise DefinitionError(f"`actuator_map` must be `gain` or `full`; got `{actuator_map}`")
        return cls(
            np.zeros(joints) if encoder_offset else None,
            None if actuator_map is None else np.zeros((joints, joints)),
            actuator_map == "full",
        )

    def robot(self, robot: Articulated) -> Articulated:
        """The arm in the encoders' positions."""
        if self.offset is None:
            return robot
        return robot.with_zero(as_array(self.offset))

    def corrected(self, signals: LogSignals) -> LogSignals:
        """The signals with the joints' torques in place of the log's."""
        if self.error is None:
            return signals
        return replace(signals, tau=np.linalg.solve(np.eye(len(self.error)) + self.error, signals.tau.T).T)

    def refined(self, unknowns: Unknowns, theta: np.ndarray, source: str) -> Instruments:
        """The instruments with the estimates of a fit.

        - `theta`: the estimate of `unknowns`.
        - `source`: name of the log, for messages.

        Raises DefinitionError if torques differ so much that no drive's gain explains it.
        """
        offset, error = self.offset, self.error
        names, joints = np.array(unknowns.names), np.array(unknowns.joints)
        if offset is not None:
            offset = np.clip(theta[names == "encoder_offset"], -0.5, 0.5)
        if error is not None:
            error = np.zeros_like(error)
            for i in np.nonzero(np.char.startswith(names, "map_"))[0]:
                error[joints[i], int(names[i].removeprefix("map_"))] = theta[i]
            row, column = np.unravel_index(np.argmax(np.abs(error)), error.shape)
            if abs(error[row, column]) > STRANGE:
                raise DefinitionError(
                    f"`actuator_map`: entry {row + 1}, {column + 1} of the torques of {source} per torque of the "
                    f"joints would be {float(row == column) + error[row, column]:.3g}, too far from "
                    f"{float(row == column):g} for a drive: check `--torque-scale`, `--torque-sign` and "
                    "`--joint-order` first, without this option"
                )
        return replace(self, offset=offset, error=error)

    def extended(self, unknowns: Unknowns, robot: Articulated, signals: LogSignals, theta: np.ndarray) -> Unknowns:
        """The equation with the instruments' errors as unknowns, linearised about these instruments and θ.

        With the torques `τ = k + Y θ` of the arm in the encoders' positions, the log has `(1 + E) (τ + ∂τ/∂q Δδ)`.

        - `unknowns`: the equation without the instruments' errors.
        - `robot`: the arm in the encoders' positions.
        - `theta`: the last estimate of `unknowns`.
        """
        n = robot.joints
        torque = unknowns.known + unknowns.columns @ theta
        mixing = np.eye(n) + (0.0 if self.error is None else self.error)
        known, columns = unknowns.known @ mixing.T, [mixing @ unknowns.columns]
        names, joints, scale = list(unknowns.names), list(unknowns.joints), list(unknowns.scale)
        if self.offset is not None:
            slope = mixing @ _slope(unknowns, robot, signals.motion, theta)
            known = known - slope @ self.offset
            columns.append(slope)
            names += n * ["encoder_offset"]
            joints += range(n)
            scale += [OFFSET[unit] for unit in robot.joint_units]
        if self.error is not None:
            known = known - torque @ self.error.T
            pairs = [(i, j) for i in range(n) for j in range(n) if self.full or i == j]
            mapped = np.zeros((*torque.shape, len(pairs)))
            for column, (i, j) in enumerate(pairs):
                mapped[:, i, column] = torque[:, j]
                names.append(f"map_{j}")
                joints.append(i)
                scale.append(GAIN if i == j else CROSSTALK)
            columns.append(mapped)
        more = len(names) - len(unknowns.names)
        return replace(
            unknowns,
            names=tuple(names),
            joints=tuple(joints),
            columns=np.concatenate(columns, axis=2),
            known=known,
            prior=np.append(unknowns.prior, np.zeros(more)),
            scale=np.array(scale),
            positive=np.append(unknowns.positive, np.zeros(more, bool)),
        )


def _slope(unknowns: Unknowns, robot: Articulated, motion: JointMotion, theta: np.ndarray) -> np.ndarray:
    """Derivative of the bodies' torques by the positions, [k n n]."""
    links, payload = parameters_of_links(robot), parameters_of_payload(robot.payload)
    for start in unknowns.bodies:
        joint, own = unknowns.joints[start], theta[start : start + BODY]
        if joint < 0:
            payload = own
        else:
            links[joint * BODY : (joint + 1) * BODY] = own
    slopes = []
    for joint in range(robot.joints):
        step = STEP * np.eye(robot.joints)[joint]
        up, down = (rigid_torque(robot, motion._replace(q=motion.q + side), links, payload) for side in (step, -step))
        slopes.append((up - down) / (2.0 * STEP))
    return np.stack(slopes, axis=2)


def in_commands(
    unknowns: Unknowns, fitted: ParameterFit, theta: np.ndarray
) -> tuple[Unknowns, ParameterFit, np.ndarray]:
    """Replace E by the actuator map G = (1 + E)⁻¹ of the joints' torques by those of the log, with its covariance."""
    own = np.char.startswith(np.array(unknowns.names), "map_")
    if not own.any():
        return unknowns, fitted, theta
    n = 1 + max(unknowns.joints)
    rows = np.array(unknowns.joints)[own]
    columns = np.array([int(name.removeprefix("map_")) for name in np.array(unknowns.names)[own]])
    error = np.zeros((n, n))
    error[rows, columns] = theta[own]
    gains = np.linalg.inv(np.eye(n) + error)
    # dG = -G dE G; entries of G that stay 0 are not unknown.
    slope = -np.einsum("ai,jb->abij", gains, gains)[rows[:, None], columns[:, None], rows, columns]
    change = np.eye(len(own))
    change[np.ix_(own, own)] = slope
    values = theta.copy()
    values[own] = gains[rows, columns]
    names = np.array(unknowns.names, object)
    names[own] = ["gain" if i == j else f"crosstalk_{j}" for i, j in zip(rows, columns, strict=True)]
    covariance = change @ fitted.covariance @ change.T
    unknowns = replace(unknowns, names=tuple(names), columns=unknowns.columns @ np.linalg.inv(change))
    return unknowns, replace(fitted, covariance=covariance), values
