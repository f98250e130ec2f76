"""Figures show themselves in a notebook, as they are printed."""

import pickle

import matplotlib as mpl
import numpy as np

from slidax.law import FixedTime
from slidax.report import figures


def picture():
    t = np.linspace(0.0, 3.0, 50)
    return figures.performance({"fixed": FixedTime(1.0, 0.1, 2.0, 2.01)}, t)


def test_a_figure_is_shown_as_svg_in_its_own_style_and_changes_no_settings():
    before = dict(mpl.rcParams)
    shown = picture()._repr_svg_()
    assert "<svg" in shown
    # Text as paths, as in what is saved; matplotlib's own default writes the same, so the typeface tells.
    assert "STIXGeneral" in shown
    assert dict(mpl.rcParams) == before


def test_it_can_still_be_copied():
    assert "<svg" in pickle.loads(pickle.dumps(picture()))._repr_svg_()
