"""Study figures are legible: separate tick labels, wide bars, and a linear count axis for few runs."""

import re
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from slidax.report import figures
from slidax.studies.study import ChartKind

RANDOM = np.random.default_rng(3)


def tick_boxes(figure, axis):
    figure.draw_without_rendering()
    low, high = sorted(axis.get_view_interval())
    labels = [label for label in axis.get_ticklabels() if label.get_text()]
    inside = [label for label, place in zip(labels, axis.get_ticklocs(), strict=False) if low <= place <= high]
    assert max(len(re.sub(r"[^0-9.]", "", label.get_text())) for label in inside) <= 5, (
        "a common power of ten keeps labels short"
    )
    return [label.get_window_extent() for label in inside]


@pytest.mark.parametrize("scale", [5e-5, 0.02, 1.0, 3e4])
@pytest.mark.parametrize("runs", [60, 5000])
def test_tick_labels_of_histograms_do_not_touch(runs, scale):
    values = scale * (1.0 + RANDOM.random(runs))
    figure = figures.histograms({"a": values, "b": values, "c": values})
    for axes in figure.axes[:3]:
        boxes = tick_boxes(figure, axes.xaxis)
        assert len(boxes) >= 2
        assert all(left.x1 + 3 < right.x0 for left, right in pairwise(boxes))


def test_histogram_count_axis_is_linear_for_few_runs_and_logarithmic_for_many():
    few, many = (RANDOM.normal(size=runs) for runs in (60, 50_000))
    figure = figures.histograms({"few": few, "many": many})
    (bars,), (more,) = ([*axes.patches] for axes in figure.axes[:2])
    assert 5 <= len(bars.get_data().values) <= 20 < len(more.get_data().values) <= 60
    assert bars.get_data().values.sum() == 60
    assert [axes.get_yscale() for axes in figure.axes[:2]] == ["linear", "symlog"]


def test_histograms_with_a_distant_outlier_have_a_bounded_number_of_bars():
    values = np.concatenate([RANDOM.normal(size=50), [1e9]])
    figure = figures.histograms({"a": values, "b": np.repeat([1.0, 2.0], [80, 2])})
    assert [len(axes.patches[0].get_data().values) for axes in figure.axes[:2]] == [20, 20]


def test_tick_labels_of_margin_charts_do_not_touch():
    values = {f"parameter {k}": scale * (1.0 + RANDOM.random(60)) for k, scale in enumerate((5e-5, 0.02, 3e4))}
    figure = figures.margin_over(RANDOM.random(60), values)
    for axes in figure.axes[:3]:
        boxes = tick_boxes(figure, axes.xaxis)
        assert len(boxes) >= 2
        assert all(left.x1 + 3 < right.x0 for left, right in pairwise(boxes))


@pytest.mark.parametrize("kind", get_args(ChartKind))
def test_every_kind_of_chart_has_a_function_that_draws_it(kind):
    assert callable(getattr(figures, kind))


def test_tick_labels_of_a_pareto_front_do_not_touch():
    error, step = np.geomspace(1.8e-7, 1.3e-6, 12), np.geomspace(0.16, 0.042, 12)
    figure = figures.pareto_front(["error", "step"], np.stack([error, step], axis=1), np.array([1.83e-7, 0.1586]), 0)
    boxes = [label.get_window_extent() for label in shown_labels(figure, figure.axes[0].xaxis)]
    assert len(boxes) >= 2 and all(left.x1 < right.x0 for left, right in pairwise(boxes))


def shown_labels(figure, axis):
    """Labels of an axis, major and minor, from left to right."""
    figure.draw_without_rendering()
    labels = [label for label in axis.get_ticklabels(which="both") if label.get_text()]
    low, high = axis.get_view_interval()
    return sorted(
        (label for label in labels if low <= label.get_position()[0] <= high), key=lambda x: x.get_position()[0]
    )
