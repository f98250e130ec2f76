from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.report import figures
from slidax.report.figures.chatter import chatter
from slidax.report.figures.compared import HATCHES, LOOKS, crest
from slidax.report.figures.style import thin_curve
from slidax.scenarios.schemes import PRESETS

LIMIT = 150_000
"""Largest size of a figure with a few schemes [bytes]."""

DRAWN = [figures.compared_errors, figures.compared_velocity_errors, figures.compared_torques]


@pytest.fixture(scope="module")
def runs():
    names = ("cftsmppc", "ftsmc", "gravity_pd")
    changes = {"simulation.t1": 3.0, "simulation.log_every": 1}
    return {n: scenarios.load("example-4.1", {"scheme.name": n, **changes}).simulate(progress=False) for n in names}


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def bands(figure):
    return [artist for axes in figure.axes for artist in axes.collections if isinstance(artist, PolyCollection)]


def test_each_joint_has_errors_on_a_linear_and_absolute_errors_on_a_logarithmic_axis(runs):
    figure = figures.compared_errors(runs, bands={"1e-3": [1e-3, 1e-3]})
    assert [axes.get_ylabel() for axes in figure.axes] == [
        *("$e_{1}$  [rad]", "$|e_{1}|$  [rad]", "$e_{2}$  [rad]", "$|e_{2}|$  [rad]")
    ]
    assert [axes.get_yscale() for axes in figure.axes] == ["linear", "log"] * 2
    assert legend(figure) == [*runs, "1e-3", "envelope of cftsmppc"]
    assert figure.axes[2].get_xlim()[1] == pytest.approx(2.0)
    assert figure.axes[3].get_xlim()[1] == pytest.approx(3.0)


def test_an_envelope_is_drawn_only_if_a_single_run_has_an_envelope(runs):
    only = figures.compared_errors(runs)
    assert len(bands(only)) == 4 and legend(only) == [*runs, "envelope of cftsmppc"]
    assert not bands(figures.compared_errors({"one": runs["cftsmppc"], "two": runs["cftsmppc"]}))
    assert not bands(figures.compared_errors({"one": runs["ftsmc"]}))


def test_chattering_torque_is_drawn_as_a_band_and_smooth_torque_as_a_line(runs):
    assert bands(figures.compared_torques({"ftsmc": runs["ftsmc"]}))
    assert not bands(figures.compared_torques({"pd": runs["gravity_pd"]}))
    assert not bands(figures.compared_torques({"cftsmppc": runs["cftsmppc"]}))


def test_chatter_detection_ignores_a_small_ripple_and_bounds_chattering_by_a_band():
    """Like a sampled-data law: from 32 to -18 N m in 30 ms, with 0.1 N m of alternating sign at each sample."""
    t = np.arange(4000) * 5e-4
    motion = 32.0 - 50.0 / (1.0 + np.exp(-(t - 0.5) / 5e-3)) + 18.0 * np.clip(t - 0.55, 0.0, 1.0)
    to_and_fro = np.where(np.arange(len(t)) % 2, 1.0, -1.0)
    assert chatter(t, motion + 0.1 * to_and_fro, 130.0) == []
    (band,) = chatter(t, motion + 4.0 * to_and_fro, 130.0)
    assert (band.t[0], band.t[-1]) == pytest.approx((0.0, t[-1]), abs=0.02)
    assert np.median(band.high - band.low) == pytest.approx(8.0, rel=1e-3)
    assert (band.high - band.low).max() < 12.0 and (np.interp(band.t, t, motion) <= band.high).all()
    assert (np.interp(band.t, t, motion) >= band.low).all()


def test_torque_limits_are_drawn_where_the_torque_comes_near_them(runs):
    item = {"cftsmppc": runs["cftsmppc"]}
    for figure in (
        figures.compared_torques(item, limits=[120.0, 1e4]),
        figures.torque(item["cftsmppc"], limits=[120.0, 1e4]),
    ):
        near, far = figure.axes[0], figure.axes[2]
        assert {line.get_ydata()[0] for line in near.lines if len(set(line.get_ydata())) == 1} >= {-120.0, 120.0}
        assert near.get_ylim()[1] > 120.0 and far.get_ylim()[1] < 1e3
        assert [axes.get_title(loc="right") for axes in (near, far)] == ["limit ±120 N m", "limit ±10000 N m"]
        assert "torque limit" in legend(figure)
    assert not figures.torque(item["cftsmppc"], limits=[np.inf, np.inf]).axes[0].get_title(loc="right")


def test_joint_labels_drop_the_words_that_all_joint_names_share(runs):
    named = replace(runs["cftsmppc"], joint_names=("arm_shoulder_joint", "arm_elbow_joint"))
    for draw in (figures.compared_errors, figures.compared_velocity_errors, figures.compared_torques):
        labels = [axes.get_ylabel().partition("\n")[0] for axes in draw({"one": named}).axes[::2]]
        assert labels == ["shoulder", "elbow"]
    for draw_one in (figures.tracking_error, figures.velocity_error, figures.torque):
        assert [axes.get_ylabel().partition("\n")[0] for axes in draw_one(named).axes[::2]] == ["shoulder", "elbow"]
    bars = figures.metric_bars({"one": [1.0, 2.0]}, "IAE", ["shoulder", "elbow"])
    assert [label.get_text() for label in bars.axes[0].get_xticklabels()] == ["shoulder", "elbow"]


def test_a_chattering_band_reaches_from_the_lowest_to_the_highest_torque(runs):
    log = runs["ftsmc"].log
    k = np.arange(len(log.t))[:, None]
    switching = eqx.tree_at(lambda r: r.log.tau, runs["ftsmc"], np.where(k % 2, 30.0, -20.0) * np.ones((1, 2)))
    drawn = list(bands(figures.compared_torques({"switching": switching})))
    assert drawn
    for band in drawn:
        heights = band.get_paths()[0].vertices[:, 1]
        assert (heights.min(), heights.max()) == (-20.0, 30.0)


@pytest.mark.parametrize("draw", DRAWN)
def test_svg_of_noisy_signals_is_small_and_reproducible(runs, draw):
    rng = np.random.default_rng(0)

    def noisy(run):
        noise = [rng.normal(size=run.log.tau.shape) for _ in range(3)]
        return eqx.tree_at(lambda r: (r.log.tau, r.log.state.q, r.log.state.dq), run, noise)

    five = {f"run {i}": noisy(run) for i, run in enumerate([*runs.values(), *runs.values()][:5])}
    text = figures.to_svg(draw(five), "noise")
    assert 5_000 < len(text) < LIMIT
    assert figures.to_svg(draw(five), "noise") == text


@pytest.mark.parametrize("draw", DRAWN)
def test_diverging_run_does_not_hide_the_others(runs, draw):
    log = runs["ftsmc"].log
    growth = np.geomspace(1.0, 1e200, len(log.t))[:, None] * np.ones((1, 2))
    where = [lambda r: r.log.tau, lambda r: r.log.state.q, lambda r: r.log.state.dq]
    away = runs["ftsmc"]
    for pick in where:
        away = eqx.tree_at(pick, away, growth)
    others = {"one": runs["cftsmppc"], "two": runs["gravity_pd"]}
    figure = draw({**others, "away": away})
    figures.to_svg(figure, "away")
    for axes in figure.axes[::2]:
        assert np.abs(axes.get_ylim()).max() < 1e4


@pytest.mark.parametrize("draw", DRAWN)
def test_invalid_runs_are_refused_with_the_reason(runs, draw):
    run = runs["cftsmppc"]
    with pytest.raises(DefinitionError, match=f"1 to {len(LOOKS)} runs; got 0"):
        draw({})
    with pytest.raises(DefinitionError, match="log_every"):
        draw({"unlogged": eqx.tree_at(lambda r: r.log, run, None)})
    other = scenarios.load("example-4.2", {"simulation.t1": 0.1}).simulate(progress=False)
    with pytest.raises(DefinitionError, match="`other` is of an arm with other joints"):
        draw({"one": run, "other": other})


def test_every_scheme_has_a_line_style_and_a_hatch():
    assert sum(preset.complete for preset in PRESETS.values()) <= len(LOOKS)
    assert len({(look["color"], look["linestyle"]) for look in LOOKS}) == len(LOOKS)
    assert len({look["linestyle"] for look in LOOKS[:5]}) == 5
    assert len(set(HATCHES)) == len(HATCHES) == len(LOOKS)


def test_the_crest_line_joins_the_peaks_from_the_first_to_the_last_time():
    t = np.linspace(0, 10, 10_001)
    x, y = crest(t, np.abs(np.sin(200 * t)) + 0.1, 50)
    assert (x[0], x[-1]) == (0.0, 10.0) and (np.diff(x) >= 0).all() and y[1:].min() > 1.09
    np.testing.assert_array_equal(crest(t[:20], t[:20], 50), [t[:20], t[:20]])


def test_tip_path_axes_ignore_stray_paths_and_spatial_paths_have_two_views():
    turn = np.linspace(0, 6, 500)
    goal = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    figure = figures.compared_tip_paths({"near": 0.9 * goal, "astray": 1e9 * goal}, goal)
    assert legend(figure) == ["near", "astray", "desired"]
    (axes,) = figure.axes
    assert axes.get_aspect() == 1.0 and np.abs(axes.get_xlim()).max() < 4.0
    spatial = goal + np.stack([0 * turn, 0 * turn, turn], axis=1)
    assert [a.get_ylabel() for a in figures.compared_tip_paths({"one": spatial}, spatial).axes] == [
        "$y$  [m]",
        "$z$  [m]",
    ]


def test_tip_path_axes_include_a_distant_start():
    turn = np.linspace(0, 1, 100)
    goal = np.stack([turn, 0 * turn, 0 * turn], axis=1)
    away = goal + np.stack([0 * turn, -1.9 * np.exp(-9 * turn), 0 * turn], axis=1)
    (axes,) = figures.compared_tip_paths({"away": away}, goal).axes
    assert axes.get_ylim()[0] < -1.9


@pytest.mark.parametrize(("values", "ticks"), [([0.02, 0.3], {"0.02", "0.1", "0.2"}), ([150.0, 900.0], {"200", "500"})])
def test_bars_within_three_decades_have_plain_tick_labels(values, ticks):
    (axes,) = figures.metric_bars({"one": values}, "IAE").axes
    axes.figure.draw_without_rendering()
    assert ticks <= {text.get_text() for text in axes.get_yticklabels()}
    assert not any(text.get_text() for text in axes.get_yticklabels(minor=True))


def test_bars_are_grouped_by_joint_and_missing_values_are_dashes(tmp_path):
    figure = figures.metric_bars({"one": [1.0, 10.0], "two": [100.0, float("nan")]}, "IAE  [rad]")
    (axes,) = figure.axes
    assert axes.get_yscale() == "log" and axes.get_ylabel() == "IAE  [rad]"
    tops = sorted(bar.get_y() + bar.get_height() for bar in axes.patches)
    assert tops == pytest.approx([1.0, 10.0, 100.0])
    assert [text.get_text() for text in axes.texts] == ["–"]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["joint 1", "joint 2"]
    assert figures.save(figure, tmp_path / "bars.svg").stat().st_size < LIMIT
    figures.to_svg(figures.metric_bars({"one": [0.0, float("inf")]}, "IAE"), "empty")
    with pytest.raises(DefinitionError, match="one per joint"):
        figures.metric_bars({"one": [1.0], "two": [1.0, 2.0]}, "IAE")


def test_removing_points_on_straight_lines_keeps_the_curve():
    t = np.linspace(0, 10, 2001)
    y = np.sin(t)
    x, z = thin_curve(t, y, 2001, (-1.0, 1.0))
    assert len(x) < 200 and np.abs(np.interp(t, x, z) - y).max() <= 2 / 450
    assert (x[0], x[-1]) == (0.0, 10.0)
