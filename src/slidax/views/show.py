"""A replay in the browser."""

from __future__ import annotations

import contextlib
import io
import threading
import time
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx

from slidax.simulation import Run

from .drawing import Drawing, drawing
from .needed import require_packages
from .player import Player

if TYPE_CHECKING:
    from .charts import Chart

RATE = 240.0
"""Frames per second of the run: at a quarter of its speed, each picture is still another one."""

MOST_FRAMES = 20_000
"""Of the whole run."""

SPEEDS = {f"{speed:g}x": speed for speed in (0.1, 0.25, 0.5, 1.0, 2.0)}
"""What time can pass at."""

LAYOUTS = ("over the arm", "side by side", "hidden")
"""Where the reference may be."""

CHART_PERIOD = 1 / 12
"""Time between two drawings of the charts and the slider while it plays [s]."""


def show(
    run: Run,
    plant: eqx.Module,
    *,
    title: str = "",
    urdf: str | Path | None = None,
    plain: bool = False,
    host: str = "127.0.0.1",
    port: int = 0,
    open_browser: bool = True,
) -> View:
    """Plays a run in the browser: the true arm, the reference as a ghost, both tips' paths, errors and torques.

    - `run`: a finished run with a log.
    - `plant`: its plant of any kind, or only the robot; a plant says the limits of the torque, what the tip
      carries, and where the table is.
    - `title`: what to call it.
    - `urdf`: a URDF of this robot; its meshes are drawn. Without it they are those of the package
      `example-robot-data`, if it is installed and has this robot, and plain shapes otherwise.
    - `plain`: plain shapes in any case.
    - `host`, `port`: where the page is served; only this machine can see it, and 0 is any free port.
    - `open_browser`: whether to open the page.

    Returns at once, with a `View` whose `wait()` keeps a script alive and whose `stop()` ends it.

    Raises DefinitionError if the run has no log, the robot is unknown or does not fit, or a package is missing.
    """
    require_show()
    drawn = drawing(run, plant, rate=RATE, most=MOST_FRAMES, title=title, urdf=urdf, plain=plain)
    view = View(drawn, host, port)
    if open_browser:
        webbrowser.open(view.url)
    return view


def require_show() -> None:
    """Raises DefinitionError if a package that `show` needs is not installed: asked before a long run, it saves it."""
    require_packages("a replay in the browser", "viser")


class View:
    """A replay that is being served; leaving a `with` block stops it.

    - `drawn`: what is shown.
    - `host`, `port`: where it is served.
    """

    def __init__(self, drawn: Drawing, host: str, port: int) -> None:
        import viser

        from .scene import Scene

        # Its greeting would stand among the tables of the command line.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self.url = f"http://{'localhost' if host == '0.0.0.0' else host}:{self._server.get_port()}"
        self._drawn = drawn
        self._frame = 0
        self._charts: list[Chart] = []
        self._charted = 0.0
        self._charting = threading.Lock()
        t = drawn.motion.t
        self._player = Player(float(t[0]), float(t[-1]), self._show)
        try:
            self._scene = Scene(self._server, drawn, beside=False)
            self._add_controls()
        except BaseException:
            self.stop()
            raise
        self._player.start()

    @property
    def time(self) -> float:
        """The time of the run that is shown [s]."""
        return self._player.time

    def seek(self, t: float) -> None:
        """Shows a time.

        - `t`: s.
        """
        self._player.seek(t)

    def play(self, playing: bool = True) -> None:
        """Lets time pass, or holds it.

        - `playing`: which.
        """
        import viser

        self._player.playing = playing
        self._button.label = "Pause" if playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY

    def wait(self) -> None:
        """Returns when the view is stopped, or by Ctrl-C, which stops it."""
        try:
            while self._player.is_alive():
                time.sleep(0.2)
        except KeyboardInterrupt:
            self.stop()

    def stop(self) -> None:
        """Ends the replay and its server."""
        self._player.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    def _add_controls(self) -> None:
        import viser

        gui, player, drawn = self._server.gui, self._player, self._drawn
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        gui.set_panel_label(drawn.title or "Replay")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        gui.add_markdown(drawn.run.outcome.message)
        self._button = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        start, end = player.start_time, player.end_time
        self._slider: Any = gui.add_slider("t [s]", start, end, (end - start) / 2000, start)
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x")
        layout = gui.add_dropdown("Reference", LAYOUTS)
        joints = gui.add_dropdown("Joint", tuple(drawn.skeleton.names))

        @self._button.on_click
        def _(_: Any) -> None:
            self.play(not player.playing)

        @self._slider.on_update
        def _(event: Any) -> None:
            # Not by the player itself, which moves the slider as well.
            if event.client is not None:
                player.seek(float(self._slider.value))

        @speed.on_update
        def _(_: Any) -> None:
            player.speed = SPEEDS[speed.value]

        @layout.on_update
        def _(_: Any) -> None:
            self._scene.desired.root.visible = layout.value != LAYOUTS[2]
            if layout.value != LAYOUTS[2]:
                self._scene.put_beside(layout.value == LAYOUTS[1])

        @joints.on_update
        def _(_: Any) -> None:
            self._chart(drawn.skeleton.names.index(joints.value))

        self._chart(0)

    def _chart(self, joint: int) -> None:
        from .charts import joint_charts

        with self._charting:
            for chart in self._charts:
                chart.remove()
            self._charts = joint_charts(self._server, self._drawn, joint)
        self._player.seek(self._player.time)

    def _show(self, t: float) -> None:
        """Called by the player."""
        number = self._drawn.motion.frame(t)
        if number != self._frame:
            self._frame = number
            with self._server.atomic():
                self._scene.frame(number)
        now = time.perf_counter()
        if not self._player.playing or now - self._charted > CHART_PERIOD:
            self._charted = now
            self._slider.value = t
            with self._charting:
                for chart in self._charts:
                    chart.show(t)
