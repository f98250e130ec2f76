"""Replays of a run: live in the browser, or recorded as one HTML file."""

from __future__ import annotations

import contextlib
import html
import io
import threading
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx

from slidax.core.errors import DefinitionError
from slidax.core.writing import write_text
from slidax.simulation.run import Run

from .drawing import Drawing, draw, require_packages

if TYPE_CHECKING:
    from .scene import ReplayChart

RATE = 240.0
"""Frames per second of simulated time: consecutive pictures differ even at a quarter of the speed."""

LIVE_FRAMES = 20_000
"""Largest number of frames of a replay in the browser."""

SPEEDS = {f"{speed:g}x": speed for speed in (0.1, 0.25, 0.5, 1.0, 2.0)}

LAYOUTS = ("over the arm", "side by side", "hidden")
"""Positions of the reference."""

TICK = 1 / 60
"""Time between two frames while the replay plays [s]."""

CHART_PERIOD = 1 / 12
"""Time between two updates of charts and slider while the replay plays [s]."""


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
    """Play a run in the browser: true arm, translucent reference, paths of both tips, errors and torques.

    Returns at once. The `View` has `wait()`, which keeps a script alive, and `stop()`.

    - `run`: a finished run with a log.
    - `plant`: any plant, or only the robot; a plant also has the torque limits, the payload and the table.
    - `title`: title of the page.
    - `urdf`: a URDF of this robot, whose meshes are drawn. Without it they come from the package
      `example-robot-data` if that is installed and has this robot; otherwise plain shapes are drawn.
    - `plain`: True to draw plain shapes in any case.
    - `host`, `port`: address of the server; only this machine can reach it by default, and port 0 takes any free port.
    - `open_browser`: True to open the page in the default browser.

    Raises DefinitionError if the run has no log, the robot is unknown or does not fit, or a package is missing.
    """
    require_show()
    drawing = draw(run, plant, rate=RATE, most=LIVE_FRAMES, title=title, urdf=urdf, plain=plain)
    view = View(drawing, host, port)
    if open_browser:
        webbrowser.open(view.url)
    return view


def require_show() -> None:
    """Raise DefinitionError if viser is not installed. Called before a long run, so that its result is not lost."""
    require_packages("a replay in the browser", "viser")


class Player(threading.Thread):
    """Thread with the clock of a replay, which restarts at the end.

    - `start_time`, `end_time`: times at which the run starts and ends [s].
    - `show`: called from this thread with each new time [s].
    """

    def __init__(self, start_time: float, end_time: float, show: Callable[[float], None]) -> None:
        super().__init__(name="slidax replay", daemon=True)
        self.start_time, self.end_time = start_time, end_time
        self.playing = False
        self.speed = 1.0
        self.time = start_time
        self._show = show
        self._changed = True
        self._lock = threading.Lock()
        self._end = threading.Event()

    def seek(self, t: float) -> None:
        """Go to time `t` [s], clipped to the run."""
        with self._lock:
            self.time = min(max(t, self.start_time), self.end_time)
            self._changed = True

    def stop(self) -> None:
        """End the thread."""
        self._end.set()
        if self.is_alive() and threading.current_thread() is not self:
            self.join()

    def run(self) -> None:
        last = time.perf_counter()
        while not self._end.wait(TICK):
            now = time.perf_counter()
            self.advance(now - last)
            last = now

    def advance(self, elapsed: float) -> None:
        """Advance by `elapsed` real time [s]."""
        with self._lock:
            if self.playing:
                t = self.time + elapsed * self.speed
                # The last frame is shown before the replay restarts.
                self.time = self.start_time if self.time >= self.end_time else min(t, self.end_time)
            changed, self._changed = self._changed or self.playing, False
            t = self.time
        if changed:
            self._show(t)


class View:
    """A replay on a running server; leaving a `with` block stops it.

    - `drawing`: content of the replay.
    - `host`, `port`: address of the server.
    """

    def __init__(self, drawing: Drawing, host: str, port: int) -> None:
        import viser

        from .scene import Scene

        # Suppress viser's greeting, which would appear in the output of the command line.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self.url = f"http://{'localhost' if host == '0.0.0.0' else host}:{self._server.get_port()}"
        self._drawing = drawing
        self._frame = 0
        self._charts: list[ReplayChart] = []
        self._last_chart = 0.0
        self._chart_lock = threading.Lock()
        t = drawing.motion.t
        self._player = Player(float(t[0]), float(t[-1]), self._show)
        try:
            self._scene = Scene(self._server, drawing, beside=False)
            self._add_controls()
        except BaseException:
            self.stop()
            raise
        self._player.start()

    @property
    def time(self) -> float:
        """The displayed time of the run [s]."""
        return self._player.time

    def seek(self, t: float) -> None:
        """Show time `t` [s]."""
        self._player.seek(t)

    def play(self, playing: bool = True) -> None:
        """Start the replay if `playing`, else pause it."""
        import viser

        self._player.playing = playing
        self._button.label = "Pause" if playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY

    def wait(self) -> None:
        """Return when the view is stopped; Ctrl-C stops it."""
        try:
            while self._player.is_alive():
                time.sleep(0.2)
        except KeyboardInterrupt:
            self.stop()

    def stop(self) -> None:
        """Stop the replay and its server."""
        self._player.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    def _add_controls(self) -> None:
        import viser

        gui, player, drawing = self._server.gui, self._player, self._drawing
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        gui.set_panel_label(drawing.title or "Replay")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        gui.add_markdown(drawing.run.outcome.message)
        self._button = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        start, end = player.start_time, player.end_time
        self._slider: Any = gui.add_slider("t [s]", start, end, (end - start) / 2000, start)
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x")
        layout = gui.add_dropdown("Reference", LAYOUTS)
        joints = gui.add_dropdown("Joint", tuple(drawing.skeleton.driven))

        @self._button.on_click
        def _(_: Any) -> None:
            self.play(not player.playing)

        @self._slider.on_update
        def _(event: Any) -> None:
            # An update without a client is by the player, which moves the slider as well.
            if event.client is not None:
                player.seek(float(self._slider.value))

        @speed.on_update
        def _(_: Any) -> None:
            player.speed = SPEEDS[speed.value]

        @layout.on_update
        def _(_: Any) -> None:
            self._scene.desired.root.visible = layout.value != LAYOUTS[2]
            if layout.value != LAYOUTS[2]:
                self._scene.place_reference(layout.value == LAYOUTS[1])

        @joints.on_update
        def _(_: Any) -> None:
            self._chart(drawing.skeleton.driven.index(joints.value))

        self._chart(0)

    def _chart(self, joint: int) -> None:
        from .scene import joint_charts

        with self._chart_lock:
            for chart in self._charts:
                chart.remove()
            self._charts = joint_charts(self._server, self._drawing, joint)
        self._player.seek(self._player.time)

    def _show(self, t: float) -> None:
        number = self._drawing.motion.frame(t)
        if number != self._frame:
            self._frame = number
            with self._server.atomic():
                self._scene.show(number)
        now = time.perf_counter()
        if not self._player.playing or now - self._last_chart > CHART_PERIOD:
            self._last_chart = now
            self._slider.value = t
            with self._chart_lock:
                for chart in self._charts:
                    chart.show(t)


RECORDED_FRAMES = 6_000
"""Largest number of frames of a recording: more would exceed the browser's memory."""


def require_record(out: str | Path) -> None:
    """Raise DefinitionError if `out` does not end in .html, or viser is not installed.

    Called before a long run, so that its result is not lost.
    """
    if Path(out).suffix.lower() != ".html":
        raise DefinitionError(f"the file name of a recording must end in .html; got `{Path(out).name}`")
    require_packages("a recorded replay", "viser")


def record(
    run: Run,
    plant: eqx.Module,
    out: str | Path,
    *,
    title: str = "",
    speed: float = 1.0,
    frames_per_second: float = 60.0,
    beside: bool = False,
    urdf: str | Path | None = None,
    plain: bool = False,
) -> Path:
    """Write the scene of `show` as one HTML file with viser's player in it, and return its path.

    Needs neither a display nor a GPU.

    - `run`, `plant`, `title`, `urdf`, `plain`: as for `show`.
    - `out`: the file, NAME.html.
    - `speed`: speed of the replay, > 0; 0.25 is slow motion.
    - `frames_per_second`: > 0; a recording has at most 6000 frames, so a long recording has fewer per second.
    - `beside`: True to draw the reference beside the true arm, not over it.

    Raises DefinitionError if the file has another ending, the run has no log, the robot is unknown, or a package is
    missing.
    """
    out = Path(out)
    require_record(out)
    for name, value in (("speed", speed), ("frames_per_second", frames_per_second)):
        if not 0 < value < float("inf"):
            raise DefinitionError(f"`{name}` must be > 0 and finite; got {value:g}")
    rate = frames_per_second / speed
    drawing = draw(run, plant, rate=rate, most=RECORDED_FRAMES, title=title, urdf=urdf, plain=plain)
    page = _recording(drawing, speed, beside)
    name = html.escape(drawing.title or "Replay")
    page = page.replace("<title>Viser</title>", f"<title>{name}</title>", 1)
    page = page.replace("{darkMode:false}", '{darkMode:matchMedia("(prefers-color-scheme: dark)").matches}', 1)
    hidden = "position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%)"
    page = page.replace("<body>", f'<body><header style="{hidden}"><h1>{name}</h1></header>', 1)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, page.replace("</body>", f"{NAMES}</body>", 1))
    return out


NAMES = """<script>
const names = {
  "button.mantine-CloseButton-root": "Close",
  "button.mantine-ActionIcon-root": "Play or pause",
  "input.mantine-NumberInput-input": "Time [s]",
  ".mantine-Slider-thumb": "Time",
  "input.mantine-Select-input": "Speed",
};
new MutationObserver(() => {
  document.getElementById("root").setAttribute("role", "main");
  for (const [place, name] of Object.entries(names)) {
    for (const one of document.querySelectorAll(place)) {
      if (!one.getAttribute("aria-label")) one.setAttribute("aria-label", name);
    }
  }
}).observe(document.body, { childList: true, subtree: true });
</script>"""
"""Names of the player's controls for screen readers: viser's player has none."""


def _recording(drawing: Drawing, speed: float, beside: bool) -> str:
    import viser

    from .scene import Scene

    frames, t = len(drawing.motion.t), drawing.motion.t
    # viser records what a server sends, so a server must run while the recording is made.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            scene = Scene(server, drawing, beside=beside)
            recorder = server.get_scene_serializer()
            for number in range(1, frames):
                recorder.insert_sleep(float(t[-1] - t[0]) / speed / (frames - 1))
                scene.show(number)
            return recorder.as_html()
        finally:
            server.stop()
