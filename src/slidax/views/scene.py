"""A drawing in the browser's scene: two arms that can be put in the pose of any frame, the ground, and the paths."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from slidax.figures.thinning import every_nth

from .drawing import Drawing
from .load import MovedLoad
from .skeleton import Poses
from .solid import ACTUAL, DESIRED, GHOST, SEE_THROUGH, THINNER, Solid
from .stage import FIELD_OF_VIEW, Stage


class Arm:
    """One of the two arms.

    - `server`: where it is shown.
    - `name`: of its node in the scene.
    - `drawing`, `poses`: its shape, and where its bodies are in each frame.
    - `ghost`: whether it is the reference: translucent, and without its stand.
    """

    def __init__(self, server: viser.ViserServer, name: str, drawing: Drawing, poses: Poses, *, ghost: bool) -> None:
        stage, solids, thinner = drawing.stage, drawing.solids, THINNER * drawing.skeleton.reach
        turn = _quaternions(stage.rotation[None])[0]
        self.root = server.scene.add_frame(name, show_axes=False, wxyz=turn, position=stage.base)
        self._places = poses.places.astype(np.float32)
        self._turns = _quaternions(poses.rotations.reshape(-1, 3, 3)).reshape(*poses.rotations.shape[:2], 4)
        carrying = sorted({solid.body for solid in solids})
        self._bodies = {
            body: server.scene.add_frame(f"{name}/{body}", show_axes=False) for body in carrying if body > 0
        }
        self.stand = server.scene.add_frame(f"{name}/0", show_axes=False, visible=not ghost)
        for number, solid in enumerate(solids):
            server.scene.add_mesh_simple(
                f"{name}/{solid.body}/{number}",
                solid.shrunk(thinner) if ghost else solid.vertices,
                solid.faces,
                color=DESIRED if ghost else solid.colour,
                opacity=GHOST if ghost else None,
                cast_shadow=not ghost,
                receive_shadow=not ghost,
            )
        self.frame(0)

    def frame(self, number: int) -> None:
        """Puts every body where it is in a frame.

        - `number`: of the frame.
        """
        for body, node in self._bodies.items():
            node.position = self._places[number, body]
            node.wxyz = self._turns[number, body]


class Carried:
    """The box that the true arm carries, and perhaps lets go.

    - `server`: where it is shown.
    - `name`: of its node in the scene, below that of the arm's base.
    - `load`: the box, and where it is in each frame.
    """

    def __init__(self, server: viser.ViserServer, name: str, load: MovedLoad) -> None:
        self._places = load.places.astype(np.float32)
        self._turns = _quaternions(load.rotations)
        self._visible = load.visible
        self.node = server.scene.add_frame(name, show_axes=False, visible=bool(load.visible[0]))
        _add_solid(server, f"{name}/box", load.solid)
        self.frame(0)

    def frame(self, number: int) -> None:
        """Puts it where it is in a frame, or takes it out of sight.

        - `number`: of the frame.
        """
        self.node.visible = bool(self._visible[number])
        self.node.position, self.node.wxyz = self._places[number], self._turns[number]


class Scene:
    """The room with both arms, and what is about them.

    - `server`: where it is shown.
    - `drawing`: what to show.
    - `beside`: whether the reference stands beside the true arm, and not over it.
    """

    def __init__(self, server: viser.ViserServer, drawing: Drawing, *, beside: bool) -> None:
        self.drawing = drawing
        self._server = server
        stage, motion = drawing.stage, drawing.motion
        self.actual = Arm(server, "/arm", drawing, motion.actual, ghost=False)
        self.desired = Arm(server, "/reference", drawing, motion.desired, ghost=True)
        self.load = None if drawing.load is None else Carried(server, "/arm/load", drawing.load)
        if drawing.table is not None:
            _add_solid(server, "/table", drawing.table, opacity=SEE_THROUGH)
        _add_ground(server, stage)
        dots = every_nth(stage.points(motion.desired_tip), 240)
        dashes = np.stack([dots[:-1:2], dots[1::2]], axis=1) if len(dots) > 2 else dots[None]
        server.scene.add_line_segments(
            "/reference tip", dashes, colors=DESIRED, thickness=3.0, thickness_units="screen"
        )
        line = every_nth(stage.points(motion.actual_tip), 1200)
        pieces = np.stack([line[:-1], line[1:]], axis=1)
        server.scene.add_line_segments("/arm tip", pieces, colors=ACTUAL, thickness=2.0, thickness_units="screen")
        server.initial_camera.fov = FIELD_OF_VIEW
        self.put_beside(beside)

    def frame(self, number: int) -> None:
        """Puts both arms, and what is carried, where they are in a frame.

        - `number`: of the frame.
        """
        self.actual.frame(number)
        self.desired.frame(number)
        if self.load is not None:
            self.load.frame(number)

    def put_beside(self, beside: bool) -> None:
        """Puts the reference beside the true arm, or over it.

        - `beside`: which.
        """
        stage = self.drawing.stage
        self.desired.root.position = stage.base + (stage.shift if beside else 0.0)
        self.desired.stand.visible = beside
        place, target = (stage.wide_camera, stage.wide_target) if beside else (stage.camera, stage.target)
        cameras: list[Any] = [
            self._server.initial_camera,
            *(client.camera for client in self._server.get_clients().values()),
        ]
        for camera in cameras:
            camera.position = place
            camera.look_at = target


def _add_solid(server: viser.ViserServer, name: str, solid: Solid, opacity: float | None = None) -> None:
    server.scene.add_mesh_simple(name, solid.vertices, solid.faces, color=solid.colour, opacity=opacity)


def _add_ground(server: viser.ViserServer, stage: Stage) -> None:
    cell = stage.tile
    side = float(np.ceil(2 * stage.size / cell) * 2 * cell)
    server.scene.add_grid(
        "/ground",
        width=side,
        height=side,
        cell_size=cell,
        section_size=5 * cell,
        cell_color=(226, 229, 233),
        section_color=(198, 203, 210),
        plane_color=(246, 247, 249),
        plane_opacity=1.0,
        shadow_opacity=0.2,
        position=np.append(np.floor(stage.target[:2] / cell) * cell, stage.ground),
    )


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """Scalar first, [k 4]."""
    return Rotation.from_matrix(rotations).as_quat(scalar_first=True).astype(np.float32)
