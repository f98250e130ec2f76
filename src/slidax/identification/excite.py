"""A motion that shows an arm's numbers."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError, each_of
from slidax.robots import Articulated, Payload

from .excitation import Excitation
from .fourier import Fourier
from .regressor import Motion
from .search import Search


def excite(
    robot: Articulated,
    *,
    seed: int,
    duration: float = 20.0,
    harmonics: int = 10,
    share: float = 0.8,
    acceleration: float | None = None,
    center: np.ndarray | None = None,
    payload: Payload | None = None,
    links: bool = False,
    rate: float = 50.0,
) -> Excitation:
    """A Fourier series per joint, within limits, whose log says most about rotors, friction, payload and links.

    `q_j(t) = c_j + Σ_k a_jk cos(kωt) + b_jk sin(kωt)` (Swevers et al., *Optimal robot excitation and identification*,
    1997), two periods of it, with the coefficients' sums such that velocity and acceleration are 0 at the start and at
    the end. Each joint's series is scaled until it reaches one of its limits. Of many random ones the best by
    D-optimality is taken, largest determinant of the information about the scaled unknowns, and changed at random as
    long as that gets better. Collisions of the arm with itself and with what stands around it are not looked at.

    - `robot`: the arm, with its limits.
    - `seed`: of the random numbers; the same seed gives the same motion.
    - `duration`: of both periods together [s].
    - `harmonics`: how many multiples of the base frequency there are, at least 3.
    - `share`: of the limits that is used at most, in (0, 1].
    - `acceleration`: the largest [rad/s² or m/s²]; three times the largest velocity, per second, if not given.
    - `center`: positions about which to move [n]; chosen within the limits if not given.
    - `payload`: the largest that the torque limits must allow; the robot's own if not given.
    - `links`: whether the links' inertial parameters are to be shown, too.
    - `rate`: rows per second of the table.

    Raises DefinitionError if a number is out of its range, or no motion keeps the torque limits.
    """
    for name, value, holds, rule in (
        ("duration", duration, 1.0 <= duration <= 600.0, "in [1, 600] s"),
        ("harmonics", harmonics, 3 <= harmonics <= 50, "in [3, 50]: rest at both ends takes two"),
        ("share", share, 0.0 < share <= 1.0, "in (0, 1]"),
        ("rate", rate, 5.0 <= rate <= 1000.0, "in [5, 1000] Hz"),
        ("acceleration", acceleration, acceleration is None or 0.0 < acceleration < np.inf, "> 0 and finite"),
    ):
        if not holds:
            raise DefinitionError(f"`{name}` of a motion that excites must be {rule}; got {value}")
    if center is not None and np.shape(center) != (robot.joints,):
        raise DefinitionError(f"`center` must have one position for {each_of(robot.joints, 'joint')}; got {center}")
    search = Search(robot, share, acceleration, center, payload or robot.payload, links)
    rng = np.random.default_rng(seed)
    series = Fourier(duration / 2.0, harmonics)
    # The rows are where the table will have them, so that limits hold at each.
    rows = max(2, round(duration * rate / 2.0))
    where, best = search.best(series, rng)
    motion = search.fitted(series, where, rows)
    torque = search.torque_share(motion)
    if torque.max() > 1.0 + 1e-9:
        joint = int(np.argmax(torque))
        raise DefinitionError(
            f"no motion was found that joint `{robot.joint_names[joint]}` has the torque for: it takes "
            f"{torque[joint]:.3g} of its share; give a `center` where it carries less, a larger `share`, or less "
            "payload"
        )
    twice = Motion(*(np.concatenate([part, part, part[:1]]) for part in motion))
    t = np.arange(2 * rows + 1) * (duration / (2 * rows))
    return Excitation(robot.joint_names, t, twice, search.shares(motion), best)
