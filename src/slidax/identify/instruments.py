"""Encoder offsets, actuator map and direction of gravity, as further unknowns of a log's torque equation.

They are the `Instruments` of a log. The equation is not linear in them, so it is linearised about their last estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, as_array

from .regression import ParameterFit
from .regressor import BODY, JointMotion, parameters_of_links, rigid_torque
from .signals import LogSignals
from .torque_model import with_gravity
from .unknowns import TILT, Unknowns

OFFSET = {"rad": 0.1, "m": 0.05}
"""Prior standard deviation of an encoder's offset [rad or m]."""

GAIN, CROSSTALK = 0.3, 0.1
"""Prior standard deviations of the relative error of a torque's gain, and of its cross-talk from another joint."""

STRANGE = 0.6
"""Largest entry of `G⁻¹ - 1` for an actuator map G; a larger one means other units, signs or another joint order."""

MAPS = ("gain", "full")
"""Forms of an actuator map: a gain for each joint, or all entries."""

STEP = 1e-4
"""Step of the positions for derivatives [rad or m]."""


@dataclass(frozen=True, eq=False)
class Instruments:
    """Estimates of encoder offsets, of errors of the torque measurement, and of gravity.

    - `offset`: true positions minus measured ones [n], rad or m; None if the encoders' zeros are known.
    - `error`: E with `τ_log = (1 + E) τ` for the joints' torques τ [n n]; None if the log has the joints' torques.
    - `full`: True if all entries of E are unknown, False if only the diagonal is.
    - `gravity`: gravity in the base frame [3], m/s²; None if its direction is known.
    """

    offset: np.ndarray | None
    error: np.ndarray | None
    full: bool
    gravity: np.ndarray | None = None

    @classmethod
    def started(
        cls, joints: int, encoder_offset: bool, actuator_map: str | None, gravity: np.ndarray | None = None
    ) -> Instruments:
        """Return the first estimate: all unknown offsets and torque errors are 0.

        - `joints`: number of joints.
        - `encoder_offset`: True if offsets are unknown.
        - `actuator_map`: None if the log has the joints' torques; `gain` or `full` as in `identify`.
        - `gravity`: first estimate of gravity [3], m/s²; None if its direction is known.

        Raises DefinitionError if `actuator_map` has another value.
        """
        if actuator_map is not None and actuator_map not in MAPS:
            raise DefinitionError(f"`actuator_map` must be `gain` or `full`; got `{actuator_map}`")
        return cls(
            np.zeros(joints) if encoder_offset else None,
            None if actuator_map is None else np.zeros((joints, joints)),
            actuator_map == "full",
            gravity,
        )

    @property
    def unknown(self) -> bool:
        """True if offsets, torque errors or the direction of gravity are unknown."""
        return not (self.offset is None and self.error is None and self.gravity is None)

    def robot(self, robot: Articulated) -> Articulated:
        """Return the arm with this gravity, as a function of the encoders' positions."""
        if self.gravity is not None:
            robot = with_gravity(robot, self.gravity)
        return robot if self.offset is None else robot.with_zero(as_array(self.offset))

    def corrected(self, signals: LogSignals) -> LogSignals:
        """Return the signals with the joints' torques `(1 + E)⁻¹ τ_log` in place of the log's τ_log."""
        if self.error is None:
            return signals
        return replace(signals, tau=np.linalg.solve(np.eye(len(self.error)) + self.error, signals.tau.T).T)

    def refined(self, unknowns: Unknowns, theta: np.ndarray, source: str) -> Instruments:
        """Return these instruments with offsets, errors and gravity from a fit's estimate.

        - `unknowns`: the fitted equation, from `extended`.
        - `theta`: the estimate of its unknowns θ [p].
        - `source`: name of the log, for messages.

        Raises DefinitionError if an entry of the torques' error is too large for a drive.
        """
        offset, error, gravity = self.offset, self.error, self.gravity
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
                    f"`actuator_map`: the torque of joint {row + 1} in {source} per true torque of joint "
                    f"{column + 1} would be {float(row == column) + error[row, column]:.3g}, too far from "
                    f"{float(row == column):g} for a drive: check `--torque-scale`, `--torque-sign` and "
                    "`--torque-order` first, without this option"
                )
        if gravity is not None:
            size = np.linalg.norm(gravity)
            gravity = gravity + tangent(gravity) @ theta[names == "gravity"]
            gravity = size * gravity / np.linalg.norm(gravity)
        return replace(self, offset=offset, error=error, gravity=gravity)

    def extended(self, unknowns: Unknowns, robot: Articulated, signals: LogSignals, theta: np.ndarray) -> Unknowns:
        """Return a log's torque equation with offsets, torque errors and gravity as further unknowns.

        The equation is linearised about these instruments and θ. Let `τ = k + Y θ` be the arm's torques at the
        encoders' positions, with the known part k and the regressor Y of `unknowns`. Then the log's torques are
        `(1 + E) (τ + ∂τ/∂q Δδ + ∂τ/∂γ Δγ)`. E is the error of the torques, and Δδ the change of the offsets. Δγ are the
        two angles of `tangent`, by which gravity turns from its last estimate.

        - `unknowns`: the equation with the arm's parameters as its only unknowns.
        - `robot`: the arm as a function of the encoders' positions.
        - `signals`: the log's signals.
        - `theta`: the last estimate of the unknowns of `unknowns` [p].
        """
        n = robot.joints
        torque = unknowns.known + unknowns.columns @ theta
        mixing = np.eye(n) + (0.0 if self.error is None else self.error)
        links, payload = _bodies(unknowns, robot, theta)
        known, columns = unknowns.known @ mixing.T, [mixing @ unknowns.columns]
        names, joints, scale = list(unknowns.names), list(unknowns.joints), list(unknowns.scale)
        if self.offset is not None:
            slope = mixing @ _slope(robot, signals.motion, links, payload)
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
        if self.gravity is not None:
            still = signals.motion._replace(dq=0.0 * signals.motion.dq, ddq=0.0 * signals.motion.ddq)
            turned = [
                rigid_torque(with_gravity(robot, axis), still, links, payload) for axis in tangent(self.gravity).T
            ]
            columns.append(mixing @ np.stack(turned, axis=2))
            names += 2 * ["gravity"]
            joints += [-1, -1]
            scale += [TILT, TILT]
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


def tangent(gravity: np.ndarray) -> np.ndarray:
    """Return the change of gravity per rad of rotation about each of two axes perpendicular to it, [3 2].

    - `gravity`: gravity in the base frame [3], m/s².
    """
    # Start from the axis of the base frame that is nearest to perpendicular to gravity.
    across = np.cross(gravity, np.eye(3)[int(np.argmin(np.abs(gravity)))])
    across *= np.linalg.norm(gravity) / np.linalg.norm(across)
    return np.column_stack([across, np.cross(gravity, across) / np.linalg.norm(gravity)])


def _bodies(unknowns: Unknowns, robot: Articulated, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters of the links [10n], and those of all bodies at the tip in this log together [10]."""
    links, payload = parameters_of_links(robot), unknowns.carried
    for start in unknowns.bodies:
        joint, own = unknowns.joints[start], theta[start : start + BODY]
        if joint >= 0:
            links[joint * BODY : (joint + 1) * BODY] = own
        elif start in unknowns.carries:
            payload = payload + own
    return links, payload


def _slope(robot: Articulated, motion: JointMotion, links: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """Return the derivative of the bodies' torques with respect to the positions, [k n n]."""
    slopes = []
    for joint in range(robot.joints):
        step = STEP * np.eye(robot.joints)[joint]
        up, down = (rigid_torque(robot, motion._replace(q=motion.q + side), links, payload) for side in (step, -step))
        slopes.append((up - down) / (2.0 * STEP))
    return np.stack(slopes, axis=2)


def in_commands(
    unknowns: Sequence[Unknowns], fitted: ParameterFit, theta: np.ndarray
) -> tuple[list[Unknowns], ParameterFit, np.ndarray]:
    """Replace the torques' error E by the actuator map `G = (1 + E)⁻¹`, `τ = G τ_log`, in a fit and its covariance.

    τ_log are the log's torques, τ the joints'. Returns the equations, the fit, and the parameters θ.

    - `unknowns`: the equation of each log.
    - `fitted`: the fit, whose covariance changes.
    - `theta`: the physically consistent θ.
    """
    names = np.array(unknowns[0].names, object)
    own = np.char.startswith(names.astype(str), "map_")
    if not own.any():
        return list(unknowns), fitted, theta
    n = 1 + max(unknowns[0].joints)
    rows = np.array(unknowns[0].joints)[own]
    columns = np.array([int(name.removeprefix("map_")) for name in names[own]])
    error = np.zeros((n, n))
    error[rows, columns] = theta[own]
    gains = np.linalg.inv(np.eye(n) + error)
    # dG = -G dE G; entries of G that stay 0 are not unknown.
    slope = -np.einsum("ai,jb->abij", gains, gains)[rows[:, None], columns[:, None], rows, columns]
    change = np.eye(len(own))
    change[np.ix_(own, own)] = slope
    values = theta.copy()
    values[own] = gains[rows, columns]
    names[own] = ["gain" if i == j else f"crosstalk_{j}" for i, j in zip(rows, columns, strict=True)]
    covariance, back = change @ fitted.covariance @ change.T, np.linalg.inv(change)
    unknowns = [replace(each, names=tuple(names), columns=each.columns @ back) for each in unknowns]
    return unknowns, replace(fitted, covariance=covariance), values
