"""The payload as a box: carried by the tip, and falling freely once it is released."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from slidax.robots import Load
from slidax.simulation import FreeBody, Run
from slidax.simulation.mujoco.box import box_like, principal

from .motion import LARGEST, SampledRun
from .skeleton import Skeleton
from .solid import LOAD, Solid


@dataclass(frozen=True)
class PayloadMotion:
    """A payload in each frame of a replay; its frame is the tip's, also after its release.

    - `solid`: the box of uniform density with the payload's mass and moments of inertia.
    - `rotations`, `places`: of its frame in the base frame [k 3 3], [k 3], m.
    - `carried`: True while the tip carries it [k].
    - `visible`: True while its pose is known [k].
    """

    solid: Solid
    rotations: np.ndarray
    places: np.ndarray
    carried: np.ndarray
    visible: np.ndarray

    def corners(self, frames: np.ndarray) -> np.ndarray:
        """Corners of the box in some `frames` (a mask [k]), in the base frame [m 3], m."""
        turned = self.solid.vertices @ self.rotations[frames].transpose(0, 2, 1)
        return (turned + self.places[frames, None]).reshape(-1, 3)


def payload_motion(run: Run, plant: eqx.Module, skeleton: Skeleton, motion: SampledRun) -> PayloadMotion | None:
    """The payload of a `run` of a `plant`, or None.

    - `skeleton`, `motion`: of its arm; the plant may be a robot without surroundings.
    """
    load = getattr(plant, "load", None)
    if not isinstance(load, Load) or not float(load.payload.mass) > 0:
        return None
    t = motion.t
    rotations = motion.actual.rotations[:, skeleton.tip_joint + 1] @ skeleton.tip_rotation
    places = motion.actual_tip.copy()
    carried = (t >= float(load.attached)) & (t < float(load.released))
    visible = carried.copy()
    free = t >= float(load.released)
    flight = None if run.load is None else _valid(run.load)
    if flight is not None and free.any():
        rotations[free], places[free] = _at(t[free], flight)
        visible |= free
    return PayloadMotion(_box(load), rotations, places, carried, visible)


def _box(load: Load) -> Solid:
    from .forms import box

    payload = load.payload
    moments, axes = principal(np.asarray(payload.inertia))
    sides = box_like(float(payload.mass), moments).sides
    return box(2 * sides, LOAD, axes, np.asarray(payload.center))


def _valid(body: FreeBody) -> FreeBody | None:
    """The finite samples of a free body; None if there are none."""
    rotation, place = np.asarray(body.rotation), np.asarray(body.place)
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(rotation).all(axis=(1, 2)) & (np.abs(place) < LARGEST).all(axis=1)
    return FreeBody(np.asarray(body.t)[valid], rotation[valid], place[valid]) if valid.any() else None


def _at(t: np.ndarray, body: FreeBody) -> tuple[np.ndarray, np.ndarray]:
    """Interpolated rotations and places; constant before the first and after the last sample."""
    places = np.stack([np.interp(t, body.t, column) for column in body.place.T], axis=1)
    if len(body.t) == 1:
        return np.tile(body.rotation, (len(t), 1, 1)), places
    slerp = Slerp(body.t, Rotation.from_matrix(body.rotation))
    return slerp(np.clip(t, body.t[0], body.t[-1])).as_matrix(), places
