import pickle
import re
import subprocess
import sys

import equinox as eqx
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.law import FixedTime
from slidax.report import figures
from slidax.report.figures.compared import LOOKS
from slidax.report.figures.style import BOUND, DARK, LIMIT, LINES, NARROW, dark_rules, every_nth, thin_curve

BYTES = 150_000
"""Largest size of a figure [bytes]."""


@pytest.fixture(scope="module")
def run():
    changes = {"simulation.t1": 1.5, "simulation.log_every": 1}
    return scenarios.load("example-4.1", changes).simulate(progress=False)


@pytest.fixture(scope="module")
def prismatic():
    return scenarios.load("example-4.2", {"simulation.t1": 0.2}).simulate(progress=False)


def labels(figure):
    return [axes.get_ylabel() for axes in figure.axes]


def test_each_joint_has_its_error_in_the_envelope_and_its_size_on_a_logarithmic_axis(run):
    figure = figures.tracking_error(run)
    assert labels(figure) == ["$e_{1}$  [rad]", "$|e_{1}|$  [rad]", "$e_{2}$  [rad]", "$|e_{2}|$  [rad]"]
    assert [axes.get_yscale() for axes in figure.axes] == ["linear", "log"] * 2
    assert [axes.get_xlabel() for axes in figure.axes[2:]] == ["$t$  [s]"] * 2
    for joint, axes in enumerate(figure.axes[::2]):
        (band,) = [artist for artist in axes.collections if isinstance(artist, PolyCollection)]
        corners = band.get_paths()[0].vertices
        assert corners[:, 1].min() == pytest.approx(run.log.envelope.lower[0, joint] if joint == 0 else -0.12, abs=1e-6)
        assert corners[:, 1].max() == pytest.approx(run.log.envelope.upper[0, joint], abs=1e-6)
        drawn = [line.get_ydata() for line in axes.lines]
        assert any(np.isclose(np.ravel(y)[0], run.log.e[0, joint]) for y in drawn)


def test_legend_names_error_and_envelope_above_the_panels_and_no_label_overlaps_another(run):
    figure = figures.tracking_error(run)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["error", "envelope", "its narrower side"]
    bottom = legend.get_window_extent().y0
    assert all(axes.get_window_extent().y1 <= bottom for axes in figure.axes)
    boxes = [axes.yaxis.label.get_window_extent() for axes in figure.axes]
    boxes += [axes.xaxis.label.get_window_extent() for axes in figure.axes[2:]]
    boxes += [axes.get_window_extent() for axes in figure.axes]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])


def test_a_run_without_an_envelope_is_drawn_without_a_band(run):
    free = eqx.tree_at(lambda r: r.log.envelope, run, None, is_leaf=lambda x: x is None)
    figure = figures.tracking_error(free)
    assert not any(axes.collections for axes in figure.axes)


def test_a_time_window_limits_the_drawn_part_of_the_run(run):
    figure = figures.tracking_error(run, window=(0.5, 0.7))
    lines = [line.get_xdata() for line in figure.axes[0].lines if len(np.ravel(line.get_xdata())) > 2]
    assert lines and all(np.min(x) >= 0.5 - 1e-9 and np.max(x) <= 0.7 + 1e-9 for x in lines)


def test_velocities_and_torques_carry_the_units_of_their_joints(prismatic):
    assert labels(figures.velocity_error(prismatic))[::2] == [
        r"$\dot{e}_{1}$  [rad/s]",
        r"$\dot{e}_{2}$  [rad/s]",
        r"$\dot{e}_{3}$  [m/s]",
    ]
    assert labels(figures.torque(prismatic))[::2] == [r"$\tau_{1}$  [N m]", r"$\tau_{2}$  [N m]", r"$\tau_{3}$  [N]"]


def test_errors_of_several_runs_are_drawn_with_printed_levels(run):
    figure = figures.error_sizes({"one": run, "two": run}, levels={"printed": [1e-3, 2e-3]})
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one", "two", "printed"]
    assert [axes.lines[-1].get_ydata()[0] for axes in figure.axes] == [1e-3, 2e-3]


def test_planar_tip_path_has_one_view_and_spatial_path_two_with_equal_scales():
    turn = np.linspace(0, 6, 50)
    flat = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    spatial = flat + np.stack([0 * turn, 0 * turn, turn], axis=1)
    for path, views in ((flat, ["$y$  [m]"]), (spatial, ["$y$  [m]", "$z$  [m]"])):
        figure = figures.tip_path(0.9 * path, path)
        assert labels(figure) == views and all(axes.get_aspect() == 1.0 for axes in figure.axes)
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["desired", "actual", "start", "end"]


def test_performance_functions_are_drawn_with_their_values():
    function = FixedTime(100.0, 0.01, 2.0, 2.01)
    figure = figures.performance({"rho": function}, np.linspace(0, 3, 61))
    (line,) = figure.axes[0].lines
    for t, radius in zip(line.get_xdata(), line.get_ydata(), strict=True):
        assert radius == pytest.approx(float(function.radius(jnp.asarray(t))))
    assert figure.axes[0].get_yscale() == "log"


def test_a_performance_function_of_several_joints_is_refused():
    with pytest.raises(DefinitionError, match="one function per joint"):
        figures.performance({"rho": FixedTime([1.0, 2.0], 0.01, 2.0, 2.01)}, np.linspace(0, 3, 5))


@pytest.mark.parametrize(
    "draw",
    [figures.tracking_error, figures.velocity_error, figures.torque, lambda run: figures.error_sizes({"run": run})],
)
def test_a_run_without_a_log_is_refused_with_the_remedy(run, draw):
    unlogged = eqx.tree_at(lambda r: r.log, run, None)
    with pytest.raises(DefinitionError, match="log_every"):
        draw(unlogged)


def test_thinning_keeps_every_peak_and_the_order_of_time():
    t = np.arange(20_001) * 1e-3
    y = np.sin(t)
    y[[7, 12_345, 19_999]] = [9.0, -8.0, 7.0]
    x, z = thin_curve(t, y, columns=200)
    assert len(x) <= 800 and (np.diff(x) > 0).all() and {9.0, -8.0, 7.0} <= set(z.tolist())
    assert x[0] == t[0] and x[-1] == t[-1]
    for column in range(200):
        start, end = 0.1 * column, 0.1 * (column + 1)
        inside = (t > start + 1e-4) & (t < end - 1e-4)
        kept = (x > start - 1e-4) & (x < end + 1e-4)
        assert z[kept].max() >= y[inside].max() and z[kept].min() <= y[inside].min()


def test_a_curve_of_few_points_is_not_thinned():
    t = np.linspace(0, 1, 50)
    x, y = thin_curve(t, t**2)
    assert x is t and (y == t**2).all() and every_nth(t, 10)[[0, -1]].tolist() == [0.0, 1.0]


def test_an_svg_is_small_reproducible_and_has_no_date_or_typeface(run, tmp_path):
    noisy = eqx.tree_at(lambda r: r.log.tau, run, np.random.default_rng(0).normal(size=run.log.tau.shape))
    for name, draw, shown in (("error", figures.tracking_error, run), ("torque", figures.torque, noisy)):
        path = figures.save(draw(shown), tmp_path / "made" / f"{name}.svg")
        text = path.read_text(encoding="utf-8")
        assert 5_000 < len(text) < BYTES and "<text" not in text and "dc:date" not in text
        assert f'id="{name}-figure_1"' in text and figures.to_svg(draw(shown), name) == text
    assert figures.save(figures.torque(run), tmp_path / "torque.pdf").read_bytes().startswith(b"%PDF")


def test_a_shortened_svg_path_keeps_the_peak(run):
    """The points of the SVG include the highest torque of the panel."""
    figure = figures.torque(run)
    text = figures.to_svg(figure, "torque")
    axes = figure.axes[0]
    peak = axes.transData.transform((0.0, float(run.log.tau[:, 0].max())))
    height = figure.get_figheight() * 72
    y = height - peak[1] * 72 / figure.dpi
    assert f" {y:.2f}" in text


def test_every_colour_of_a_figure_has_a_counterpart_for_dark_pages(run):
    for draw in (figures.torque, figures.tracking_error):
        text = figures.to_svg(draw(run), "dark")
        assert "prefers-color-scheme:dark" in text
        drawing = text.partition("</style>")[2]
        assert set(re.findall(r"(?:fill|stroke):(#[0-9a-f]{6})", drawing)) <= set(DARK)


def contrast(first, second):
    """Contrast of two colours by the WCAG 2.2 formula."""

    def luminance(color):
        parts = np.array(to_rgb(color))
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("look", [*LOOKS, *LINES, BOUND, NARROW, LIMIT], ids=lambda look: look["color"])
def test_a_line_contrasts_with_light_and_dark_pages(look):
    color = look["color"].lower()
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast(color, "#ffffff") >= 3.0
    assert contrast(DARK.get(color, color), DARK["#ffffff"]) >= 3.0


def test_dark_colour_rules_also_match_marks_in_shadow_trees():
    """Browsers draw a mark in a shadow tree, in which a rule with an ancestor in its selector matches nothing."""
    rules = re.findall(r"([^{}]+)\{[^{}]*!important\}", dark_rules("figure svg"))
    assert len(rules) == 2 * len(DARK)
    assert all(re.fullmatch(r'\[style\*="(fill|stroke):#[0-9a-f]{6}"\]', rule) for rule in (*rules[1:], rules[0][-24:]))


def test_a_printed_level_below_all_errors_is_inside_the_axes(run):
    figure = figures.error_sizes({"one": run}, levels={"printed": [3e-11, 2e-9]})
    assert all(axes.get_ylim()[0] < 3e-11 for axes in figure.axes)


def test_an_inline_svg_refers_to_no_other_file(run):
    page = figures.inline_svg(figures.to_svg(figures.torque(run), "torque"))
    assert page.startswith("<svg ") and page.endswith("</svg>") and "http" not in page


def test_drawing_and_saving_a_figure_leaves_the_settings_of_matplotlib_unchanged(tmp_path):
    before = dict(mpl.rcParams)
    figures.performance({"rho": FixedTime(1.0, 0.1, 2.0, 2.01)}, np.linspace(0, 3, 50))
    assert dict(mpl.rcParams) == before
    # An empty figure is the quickest to write.
    figures.to_svg(Figure(), "empty")
    assert dict(mpl.rcParams) == before
    figures.save(Figure(), tmp_path / "empty.pdf")
    assert dict(mpl.rcParams) == before


def test_figure_is_shown_in_a_notebook_in_its_own_style_and_can_be_copied():
    figure, before = (
        figures.performance({"rho": FixedTime(1.0, 0.1, 2.0, 2.01)}, np.linspace(0, 3, 50)),
        dict(mpl.rcParams),
    )
    # Text is drawn as paths, in the typeface of saved figures.
    assert "<svg" in figure._repr_svg_() and "STIXGeneral" in figure._repr_svg_() and dict(mpl.rcParams) == before
    assert "<svg" in pickle.loads(pickle.dumps(figure))._repr_svg_()


def test_running_a_scenario_loads_neither_plotting_nor_statistics_packages():
    code = """
import sys
from slidax.cli import main
sys.argv[1:] = ["run", "example-4.1", "--set", "simulation.t1=0.01"]
try:
    main()
finally:
    print("loaded:", {"matplotlib", "jinja2", "scipy.stats", "scipy.optimize"} & set(sys.modules), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Inside the envelope" in done.stdout and "loaded: set()" in done.stderr
