"""Positions of a log against the joints' limits, and velocities against the slope of the positions."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Articulated

from .conventions import TIME_UNITS
from .log import Log

DEGREE = np.pi / 180.0

WINDS = 4.0 * np.pi
"""A position, rad, that a turning joint without limits hardly reaches."""

BEYOND = 0.5
"""The excess over its limits, as a share of its range, above which a joint's unit is in doubt."""

APART = 0.3
"""A difference between dq and the slope of q, as a share of the slope, above which dq is not used."""

ALIKE = 0.9
"""The correlation of dq with the slope of q above which a factor between them is a matter of units."""

TRAVEL = {"rad": 0.02, "m": 0.005}
"""A range of positions below which a joint is held, and its dq shows nothing about units."""

LATE = 0.1
"""The time by which dq may come after the slope of q, s."""


def require_radians(log: Log, robot: Articulated) -> None:
    """Raise a DefinitionError if positions look like degrees, millimetres or revolutions.

    - `log`: in the arm's joint order.
    - `robot`: its position limits.
    """
    lower, upper = np.asarray(robot.limits.lower), np.asarray(robot.limits.upper)
    least, most = log.q.min(axis=0), log.q.max(axis=0)
    turning = np.array([unit == "rad" for unit in robot.joint_units])
    limited = np.isfinite(lower) & np.isfinite(upper)
    slack = BEYOND * np.where(limited, upper - lower, 0.0)
    outside = np.where(limited, (most > upper + slack) | (least < lower - slack), turning & (_largest(log) > WINDS))
    for kind, size, unit in ((turning, DEGREE, "deg"), (~turning, 1e-3, "mm")):
        wrong = outside & kind
        if not wrong.any():
            continue
        joint = int(np.argmax(np.where(wrong, _largest(log), 0.0)))
        fits = (~limited | ((most * size <= upper + slack) & (least * size >= lower - slack)))[kind].all()
        right = "rad" if unit == "deg" else "m"
        limits = f"; its limits are {lower[joint]:.4g} to {upper[joint]:.4g} {right}" if limited[joint] else ""
        facts = (
            f"positions of {log.source} go from {least[joint]:.4g} to {most[joint]:.4g} for joint "
            f"`{log.joints[joint]}`{limits}"
        )
        if fits:
            what = "degrees" if unit == "deg" else "millimetres"
            raise DefinitionError(f"{facts}: are they {what}? `--position-unit {unit}` reads them so")
        if limited[joint]:
            raise DefinitionError(
                f"{facts}: check `--position-unit`, `--position-order`, and `--position-offset` for another zero"
            )


def _largest(log: Log) -> np.ndarray:
    return np.abs(log.q).max(axis=0)


def usable_velocities(
    log: Log, robot: Articulated, slope: np.ndarray, velocity: np.ndarray, noise: np.ndarray, rate: float
) -> tuple[np.ndarray, list[str]]:
    """True for each joint whose measured velocity agrees with the slope of its positions [n]; and warnings.

    - `log`, `robot`: of the positions.
    - `slope`, `velocity`: of the positions, and as measured, in the band of the equations [k n].
    - `noise`: standard deviation of the slope there [n].
    - `rate`: samples per second [Hz].

    Raises DefinitionError if a joint's velocity is a clear multiple of the slope, as with a wrong unit.
    """
    size, theirs = _rms(slope), _rms(velocity)
    usable = _rms(velocity - slope) <= APART * size
    if usable.all():
        return usable, []
    travels = np.ptp(log.q, axis=0) > np.array([TRAVEL[unit] for unit in robot.joint_units])
    travels &= size > 5.0 * noise
    if not (theirs > 1e-3 * size)[travels].any() and travels.any():
        return np.zeros_like(usable), [f"`dq` of {log.source} is 0 throughout while the arm moves: it is left out"]
    factors: dict[int, float] = {}
    for joint in np.nonzero(~usable & travels)[0]:
        factor, alike = _factor(slope[:, joint], velocity[:, joint], rate)
        if alike > ALIKE and not 0.75 < factor < 1.33:
            factors[int(joint)] = factor
    if factors:
        raise DefinitionError(_units(log, factors, int(travels.sum())))
    _require_own(log, slope, velocity, usable, travels)
    names = ", ".join(f"`{log.joints[joint]}`" for joint in np.nonzero(~usable)[0])
    return usable, [f"`dq` of {log.source} does not follow the slope of `q` for {names}: it is left out there"]


def _factor(slope: np.ndarray, velocity: np.ndarray, rate: float) -> tuple[float, float]:
    """The factor between the two at the delay at which they are most alike, and their correlation there."""
    most = max(1, min(int(LATE * rate), len(slope) // 4))
    best = (0.0, 0.0)
    for shift in np.unique(np.linspace(-most, most, 41).astype(int)):
        a = slope[max(0, -shift) : len(slope) - max(0, shift)]
        b = velocity[max(0, shift) : len(velocity) - max(0, -shift)]
        product = float(a @ b)
        alike = abs(product) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)
        if alike > best[1]:
            best = (product / max(float(a @ a), 1e-300), alike)
    return best


def _units(log: Log, factors: dict[int, float], travelling: int) -> str:
    joint = max(factors, key=lambda j: abs(np.log(abs(factors[j]))))
    factor = factors[joint]
    values = np.array(list(factors.values()))
    facts = f"`dq` of {log.source} is not the slope of `q` for joint `{log.joints[joint]}`: it is {factor:.3g} times it"
    leave = "`--drop dq` leaves `dq` out"
    if len(factors) < travelling or np.ptp(values) > 0.2 * abs(factor):
        if abs(factor + 1.0) < 0.2:
            return f"{facts}; does `q` or `dq` count in the opposite direction? `--position-sign` turns both, {leave}"
        return f"{facts}; {leave}"
    for name, unit in TIME_UNITS.items():
        if name != "s" and abs(factor * unit - 1.0) < 0.2:
            return f"{facts}: are the times in {name}? `--time-unit {name}` reads them so; {leave}"
    if abs(factor * DEGREE - 1.0) < 0.2:
        return f"{facts}: is `dq` in degrees per second? {leave}"
    if abs(factor / DEGREE - 1.0) < 0.2:
        return f"{facts}: is `q` in degrees? `--position-unit deg --drop dq` reads it so"
    if factor > 0.0:
        size = f"{1.0 / factor:.4g}"
        return f"{facts} in all joints: are the times in units of {size} s? `--time-unit {size}` reads them so; {leave}"
    return f"{facts} in all joints; {leave}"


def _require_own(log: Log, slope: np.ndarray, velocity: np.ndarray, usable: np.ndarray, travels: np.ndarray) -> None:
    """Raises a DefinitionError if a joint's velocity is the slope of another joint's position."""
    for joint in np.nonzero(~usable & travels)[0]:
        for other in np.nonzero(~usable & travels)[0]:
            if joint != other and _rms(velocity[:, joint] - slope[:, other]) < 0.2 * _rms(slope[:, other]):
                raise DefinitionError(
                    f"`dq` of {log.source} for joint `{log.joints[joint]}` is the slope of `q` for joint "
                    f"`{log.joints[other]}`: positions and velocities are in different joint orders; "
                    "`--drop dq` leaves `dq` out"
                )


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))
