"""Films by MuJoCo: the arms as bodies of a model, placed in each frame and drawn without a window."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from slidax._errors import DefinitionError
from slidax.figures.thinning import every_nth

from .drawing import Drawing
from .forms import tube
from .load import MovedLoad
from .solid import ACTUAL, DESIRED, GHOST, SEE_THROUGH, THINNER, Colour
from .stage import FIELD_OF_VIEW, Stage

NO_GRAPHICS = (
    "MuJoCo can't draw on this machine: {error}. A film needs OpenGL without a window: install EGL (libegl1) or OSMesa "
    "(libosmesa6) and set MUJOCO_GL to egl or osmesa before Python starts; or record to a file ending in .html, which "
    "needs no graphics here"
)


LOAD_GROUP = 1
"""MuJoCo's group of what is carried, of which it can draw all or nothing."""


class Studio:
    """Draws the frames of a drawing; leaving a `with` block closes it.

    - `drawing`: what to draw.
    - `beside`: whether the reference stands beside the true arm.
    - `width`, `height`: of a picture [px].

    Raises DefinitionError if this machine can't draw without a window.
    """

    def __init__(self, drawing: Drawing, *, beside: bool, width: int, height: int) -> None:
        try:
            import mujoco
        except Exception as error:  # an unknown MUJOCO_GL, or one whose library is missing
            raise DefinitionError(NO_GRAPHICS.format(error=error)) from error
        stage, motion = drawing.stage, drawing.motion
        spec = _room(mujoco, stage, width, height)
        self._places: list[np.ndarray] = []
        self._turns: list[np.ndarray] = []
        for ghost in (False, True):
            self._add_arm(mujoco, spec, drawing, ghost=ghost, beside=beside)
        self._shown = None if drawing.load is None else drawing.load.visible
        if drawing.load is not None:
            self._add_load(mujoco, spec, stage, drawing.load)
        if drawing.table is not None:
            table = drawing.table
            colour = _rgba(table.colour, SEE_THROUGH)
            _add_mesh(mujoco, spec, spec.worldbody, table.vertices, table.faces, colour)
        thick = 0.0018 * stage.size
        dashes = tube(every_nth(stage.points(motion.desired_tip), 161), 1.2 * thick, DESIRED, dashed=True)
        for solid in (dashes, tube(every_nth(stage.points(motion.actual_tip), 240), thick, ACTUAL)):
            _add_mesh(mujoco, spec, spec.worldbody, solid.vertices, solid.faces, _rgba(solid.colour))
        self._mujoco = mujoco
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._camera = _camera(mujoco, stage, wide=beside)
        self._view = mujoco.MjvOption()
        self._size = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + 100)
        try:
            self._graphics = _graphics(mujoco, width, height)
            self._graphics.make_current()
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:  # whatever the graphics of a machine throw
            raise DefinitionError(NO_GRAPHICS.format(error=str(error) or type(error).__name__)) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def picture(self, number: int) -> np.ndarray:
        """A frame [height width 3], 0 to 255.

        - `number`: of the frame.
        """
        model, data, mujoco = self._model, self._data, self._mujoco
        for body, (places, turns) in enumerate(zip(self._places, self._turns, strict=True)):
            data.mocap_pos[body], data.mocap_quat[body] = places[number], turns[number]
        if self._shown is not None:
            self._view.geomgroup[LOAD_GROUP] = self._shown[number]
        mujoco.mj_forward(model, data)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, self._view, None, self._camera, everything, self._scene)
        self._graphics.make_current()
        mujoco.mjr_render(self._size, self._scene, self._context)
        picture = np.empty((self._size.height, self._size.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, self._size, self._context)
        return picture[::-1]

    def close(self) -> None:
        """Gives the graphics back."""
        self._context.free()
        self._graphics.free()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _add_arm(self, mujoco: Any, spec: Any, drawing: Drawing, *, ghost: bool, beside: bool) -> None:
        stage, thinner = drawing.stage, THINNER * drawing.skeleton.reach
        poses = drawing.motion.desired if ghost else drawing.motion.actual
        shift = stage.shift if ghost and beside else np.zeros(3)
        bodies: dict[int, Any] = {}
        for solid in drawing.solids:
            if ghost and solid.body == 0 and not beside:
                continue
            if solid.body not in bodies:
                bodies[solid.body] = spec.worldbody.add_body(mocap=True)
                turned = stage.rotation @ poses.rotations[:, solid.body]
                self._places.append(stage.points(poses.places[:, solid.body]) + shift)
                self._turns.append(Rotation.from_matrix(turned).as_quat(scalar_first=True))
            vertices = solid.shrunk(thinner) if ghost else solid.vertices
            colour = _rgba(DESIRED, GHOST) if ghost else _rgba(solid.colour)
            _add_mesh(mujoco, spec, bodies[solid.body], vertices, solid.faces, colour)

    def _add_load(self, mujoco: Any, spec: Any, stage: Stage, load: MovedLoad) -> None:
        self._places.append(stage.points(load.places))
        self._turns.append(Rotation.from_matrix(stage.rotation @ load.rotations).as_quat(scalar_first=True))
        body, solid = spec.worldbody.add_body(mocap=True), load.solid
        _add_mesh(mujoco, spec, body, solid.vertices, solid.faces, _rgba(solid.colour), group=LOAD_GROUP)


def _graphics(mujoco: Any, width: int, height: int) -> Any:
    """Where MuJoCo draws: what MUJOCO_GL says, else EGL where there is no display.

    Not by `mujoco.Renderer`, whose choice falls when MuJoCo is first imported, by whomever, and is then a window.
    """
    displays = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in displays):
        return import_module("mujoco.egl").GLContext(width, height)
    return mujoco.GLContext(width, height)


def _room(mujoco: Any, stage: Stage, width: int, height: int) -> Any:
    """An empty room with light and a floor of tiles."""
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.global_.fovy = float(np.degrees(FIELD_OF_VIEW))
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.22, 0.22, 0.22]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 2048
    spec.visual.map.shadowclip = 2.0
    spec.stat.extent, spec.stat.center = stage.size, stage.target
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50.0
    skybox = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    gradient = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    spec.add_texture(name="sky", type=skybox, builtin=gradient, rgb1=[1, 1, 1], rgb2=[1, 1, 1], width=64, height=384)
    spec.add_texture(
        name="tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.95, 0.955, 0.96],
        markrgb=[0.74, 0.76, 0.79],
        width=400,
        height=400,
    )
    floor = spec.add_material(name="floor", texuniform=True, texrepeat=[1 / stage.tile, 1 / stage.tile])
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    half = 2 * stage.size
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[half, half, 0.1],
        pos=[stage.target[0], stage.target[1], stage.ground],
        material="floor",
        contype=0,
        conaffinity=0,
    )
    above = stage.target + stage.size * np.array([0.4, -0.6, 1.6])
    spec.worldbody.add_light(
        pos=above,
        dir=(stage.target - above) / np.linalg.norm(stage.target - above),
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.42, 0.42, 0.42],
        specular=[0.1, 0.1, 0.1],
        castshadow=True,
    )
    return spec


def _add_mesh(
    mujoco: Any, spec: Any, body: Any, vertices: np.ndarray, faces: np.ndarray, colour: np.ndarray, group: int = 0
) -> None:
    mesh = spec.add_mesh(name=f"mesh {len(spec.meshes)}")
    mesh.uservert, mesh.userface = vertices.ravel(), faces.ravel()
    # The inertia of a closed body could not be had of every mesh; nothing here asks for it.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    kind = mujoco.mjtGeom.mjGEOM_MESH
    body.add_geom(type=kind, meshname=mesh.name, rgba=colour, group=group, contype=0, conaffinity=0)


def _camera(mujoco: Any, stage: Stage, *, wide: bool) -> Any:
    place, target = (stage.wide_camera, stage.wide_target) if wide else (stage.camera, stage.target)
    away = target - place
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = target
    camera.distance = float(np.linalg.norm(away))
    camera.azimuth = float(np.degrees(np.arctan2(away[1], away[0])))
    camera.elevation = float(np.degrees(np.arcsin(away[2] / camera.distance)))
    return camera


def _rgba(colour: Colour, opacity: float = 1.0) -> np.ndarray:
    return np.array([*np.array(colour) / 255, opacity], dtype=np.float32)
