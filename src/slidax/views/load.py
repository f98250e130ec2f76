"""What the tip carries, as a box: with the tip while it is carried, on its own way once it is let go."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from slidax.robots import Load
from slidax.simulation import FreeBody, Run
from slidax.simulation.mujoco.box import box_like, principal

from .motion import LARGEST, Motion
from .skeleton import Skeleton
from .solid import LOAD, Solid


@dataclass(frozen=True)
class MovedLoad:
    """A load in each frame of a film; its frame is the tip's, and stays with it when it is let go.

    - `solid`: the box of even density with its mass and moments.
    - `rotations`, `places`: of its frame in the base frame [k 3 3], [k 3], m.
    - `carried`: whether the tip carries it [k].
    - `visible`: whether it is to be seen [k]: while it is carried, and then as far as the run knows where it went.
    """

    solid: Solid
    rotations: np.ndarray
    places: np.ndarray
    carried: np.ndarray
    visible: np.ndarray

    def corners(self, shown: np.ndarray) -> np.ndarray:
        """All that is solid of it in some frames, in the base frame [m 3], m.

        - `shown`: in which [k].
        """
        turned = self.solid.vertices @ self.rotations[shown].transpose(0, 2, 1)
        return (turned + self.places[shown, None]).reshape(-1, 3)


def load_of(run: Run, plant: eqx.Module, skeleton: Skeleton, motion: Motion) -> MovedLoad | None:
    """The load of a plant; None if it has none.

    - `run`, `plant`, `skeleton`, `motion`: of the arm; the plant may be a bare robot.
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
    way = None if run.load is None else _sound(run.load)
    if way is not None and free.any():
        rotations[free], places[free] = _at(t[free], way)
        visible |= free
    return MovedLoad(_box(load), rotations, places, carried, visible)


def _box(load: Load) -> Solid:
    from .forms import box

    payload = load.payload
    moments, axes = principal(np.asarray(payload.inertia))
    sides = box_like(float(payload.mass), moments).sides
    return box(2 * sides, LOAD, axes, np.asarray(payload.center))


def _sound(way: FreeBody) -> FreeBody | None:
    """Without what can't be shown, as where a run has failed; None if nothing is left."""
    rotation, place = np.asarray(way.rotation), np.asarray(way.place)
    with np.errstate(invalid="ignore"):
        sound = np.isfinite(rotation).all(axis=(1, 2)) & (np.abs(place) < LARGEST).all(axis=1)
    return FreeBody(np.asarray(way.t)[sound], rotation[sound], place[sound]) if sound.any() else None


def _at(t: np.ndarray, way: FreeBody) -> tuple[np.ndarray, np.ndarray]:
    """Axes and places at times; those before the first and after the last sample are the nearest one's."""
    places = np.stack([np.interp(t, way.t, column) for column in way.place.T], axis=1)
    if len(way.t) == 1:
        return np.tile(way.rotation, (len(t), 1, 1)), places
    turns = Slerp(way.t, Rotation.from_matrix(way.rotation))(np.clip(t, way.t[0], way.t[-1]))
    return turns.as_matrix(), places
