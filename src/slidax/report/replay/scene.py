"""The scene in the browser, and live charts of one joint."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from ..figures.style import BOUND, LINES, every_nth, log_of, thin_curve
from .drawing import FIELD_OF_VIEW, Drawing, PayloadMotion, SceneStage
from .skeleton import Poses, valid_samples
from .solids import ACTUAL, DESIRED, GHOST, SEE_THROUGH, THINNER, Solid


class ArmNodes:
    """Scene nodes of the true arm, or of the reference.

    - `server`: displays the scene.
    - `name`: name of the root node.
    - `drawing`, `poses`: shapes and poses of the bodies.
    - `ghost`: draw the reference: translucent, and without its stand.
    """

    def __init__(self, server: viser.ViserServer, name: str, drawing: Drawing, poses: Poses, *, ghost: bool) -> None:
        stage, solids, thinner = drawing.stage, drawing.solids, THINNER * drawing.skeleton.reach
        upright = _quaternions(stage.rotation[None])[0]
        self.root = server.scene.add_frame(name, show_axes=False, wxyz=upright, position=stage.base)
        self._positions = poses.positions.astype(np.float32)
        self._turns = _quaternions(poses.rotations.reshape(-1, 3, 3)).reshape(*poses.rotations.shape[:2], 4)
        moving = sorted({solid.body for solid in solids if solid.body > 0})
        self._bodies = {body: server.scene.add_frame(f"{name}/{body}", show_axes=False) for body in moving}
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
        self.show(0)

    def show(self, number: int) -> None:
        """Move every body to its pose in frame `number`."""
        for body, node in self._bodies.items():
            node.position = self._positions[number, body]
            node.wxyz = self._turns[number, body]


class PayloadNode:
    """Scene node of the payload.

    - `server`: displays the scene.
    - `name`: name of the node, below the base of the true arm.
    - `payload`: box and motion of the payload.
    """

    def __init__(self, server: viser.ViserServer, name: str, payload: PayloadMotion) -> None:
        self._positions = payload.positions.astype(np.float32)
        self._turns = _quaternions(payload.rotations)
        self._visible = payload.visible
        self.node = server.scene.add_frame(name, show_axes=False, visible=bool(payload.visible[0]))
        _add_solid(server, f"{name}/box", payload.solid)
        self.show(0)

    def show(self, number: int) -> None:
        """Move the payload to its pose in frame `number`, or hide it."""
        self.node.visible = bool(self._visible[number])
        self.node.position, self.node.wxyz = self._positions[number], self._turns[number]


class Scene:
    """The browser's scene: both arms, payload, table, ground and tip paths.

    - `server`: displays the scene.
    - `drawing`: content of the scene.
    - `beside`: place the reference beside the true arm, not over it.
    """

    def __init__(self, server: viser.ViserServer, drawing: Drawing, *, beside: bool) -> None:
        self.drawing = drawing
        self._server = server
        stage, motion = drawing.stage, drawing.motion
        self.actual = ArmNodes(server, "/arm", drawing, motion.actual, ghost=False)
        self.desired = ArmNodes(server, "/reference", drawing, motion.desired, ghost=True)
        self.payload = None if drawing.payload is None else PayloadNode(server, "/arm/load", drawing.payload)
        if drawing.table is not None:
            _add_solid(server, "/table", drawing.table, opacity=SEE_THROUGH)
        _add_ground(server, stage)
        dots = every_nth(stage.points(motion.desired_tip), 240)
        dashes = np.stack([dots[:-1:2], dots[1::2]], axis=1) if len(dots) > 2 else dots[None]
        line = every_nth(stage.points(motion.actual_tip), 1200)
        pieces = np.stack([line[:-1], line[1:]], axis=1)
        for name, segments, colour, width in (
            ("/reference tip", dashes, DESIRED, 3.0),
            ("/arm tip", pieces, ACTUAL, 2.0),
        ):
            server.scene.add_line_segments(name, segments, colors=colour, thickness=width, thickness_units="screen")
        server.initial_camera.fov = FIELD_OF_VIEW
        self.place_reference(beside)

    def show(self, number: int) -> None:
        """Move both arms and the payload to their poses in frame `number`."""
        self.actual.show(number)
        self.desired.show(number)
        if self.payload is not None:
            self.payload.show(number)

    def place_reference(self, beside: bool) -> None:
        """Place the reference beside the true arm if `beside`, else over it."""
        stage = self.drawing.stage
        self.desired.root.position = stage.base + (stage.shift if beside else 0.0)
        self.desired.stand.visible = beside
        position, target = (stage.wide_camera, stage.wide_target) if beside else (stage.camera, stage.target)
        clients = self._server.get_clients().values()
        cameras: list[Any] = [self._server.initial_camera, *(client.camera for client in clients)]
        for camera in cameras:
            camera.position = position
            camera.look_at = target


def _add_solid(server: viser.ViserServer, name: str, solid: Solid, opacity: float | None = None) -> None:
    server.scene.add_mesh_simple(name, solid.vertices, solid.faces, color=solid.colour, opacity=opacity)


def _add_ground(server: viser.ViserServer, stage: SceneStage) -> None:
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
    """Return rotation matrices [k 3 3] as unit quaternions [k 4], scalar first."""
    return Rotation.from_matrix(rotations).as_quat(scalar_first=True).astype(np.float32)


ALLOWED = "rgba(0, 114, 178, 0.09)"
"""Fill colour between the bounds."""

HIDDEN: Any = {"show": False}
THIN: Any = {"grid": {"stroke": "#eceef1", "width": 1}, "ticks": {"width": 1, "size": 4, "stroke": "#b8bec6"}}


class ReplayChart:
    """A quantity over time with its bounds, and a vertical line at the displayed time.

    - `server`: displays the chart.
    - `t`, `value`: times [k], s, and values [k].
    - `bounds`: lower and upper bound, [k] each; None for no bounds.
    - `label`: label of the quantity, with its unit.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        t: np.ndarray,
        value: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray] | None,
        label: str,
    ) -> None:
        # Every update sends the curves again, so they have few points; every peak of the value is among them.
        times, _ = thin_curve(t, value, columns=120)
        chosen = np.searchsorted(t, times)
        self._curves = [curve[chosen].astype(float) for curve in (t, value, *(bounds or ()))]
        low = min(float(curve.min()) for curve in self._curves[1:])
        high = max(float(curve.max()) for curve in self._curves[1:])
        margin = 0.05 * (high - low) or 1e-9
        self._range = (low - margin, high + margin)
        series: list[Any] = [{"label": label, "points": HIDDEN, "stroke": LINES[0]["color"], "width": 1.5}]
        for name in ("lower", "upper")[: len(self._curves) - 2]:
            series.append({"label": name, "points": HIDDEN, "stroke": BOUND["color"], "width": 1.0})
        series.append({"label": "now", "points": HIDDEN, "stroke": "#222222", "width": 1.0})
        self._chart = server.gui.add_uplot(
            self._data(float(t[0])),
            ({"label": "t"}, *series),
            title=label,
            bands=({"series": (3, 2), "fill": ALLOWED},) if bounds is not None else None,
            scales={"x": {"time": False, "range": (float(t[0]), float(t[-1]))}, "y": {"range": self._range}},
            axes=(THIN | {"size": 28}, THIN | {"size": 58}),
            legend={"show": False},
            height=190,
            padding=(4, 12, 0, 0),
        )

    def show(self, t: float) -> None:
        """Move the vertical line to time `t` [s]."""
        self._chart.data = self._data(t)

    def remove(self) -> None:
        """Remove the chart from the page."""
        self._chart.remove()

    def _data(self, now: float) -> tuple[np.ndarray, ...]:
        """Return times and curves of the chart, which share the times: the line at `now` adds two equal times."""
        times = self._curves[0]
        index = int(np.searchsorted(times, now))
        axis = np.insert(times, index, [now, now])
        curves = [np.insert(curve, index, [np.interp(now, times, curve)] * 2) for curve in self._curves[1:]]
        line = np.full(len(axis), np.nan)
        line[index : index + 2] = self._range
        return (axis, *curves, line)


def joint_charts(server: viser.ViserServer, drawing: Drawing, joint: int) -> list[ReplayChart]:
    """Add the charts of a joint's error and torque to the page, and return them.

    - `server`, `drawing`: server of the page, and content of the replay.
    - `joint`: index from 0.
    """
    log = log_of(drawing.run)
    valid = valid_samples(log)
    t, error, tau = (np.asarray(values)[valid] for values in (log.t, log.e[:, joint], log.tau[:, joint]))
    envelope = None
    if log.envelope is not None:
        lower, upper = np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
        envelope = (lower[valid, joint], upper[valid, joint])
    limit = drawing.torque_limits[joint]
    limits = (np.full(len(t), -limit), np.full(len(t), limit)) if np.isfinite(limit) else None
    return [
        ReplayChart(server, t, error, envelope, f"error [{drawing.run.joint_units[joint]}]"),
        ReplayChart(server, t, tau, limits, f"torque [{drawing.run.torque_units[joint]}]"),
    ]
