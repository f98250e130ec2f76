"""The bar: there when asked for, away when not, and never in the way of the numbers."""

import jax
import numpy as np

from slidax.simulation import simulate
from slidax.simulation.engine import Progress
from tests.paper_examples import MOTION_4_1, START_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING


def run(progress):
    return simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, progress=progress)


def test_the_bar_shows_when_it_is_asked_for(capfd):
    with Progress(3, shown=True) as bar:
        bar.advance()
    assert "simulating" in capfd.readouterr().err


def test_a_run_draws_its_bar_on_standard_error_and_nothing_on_standard_output(capfd):
    run(True)
    shown = capfd.readouterr()
    assert "simulating" in shown.err
    assert shown.out == ""


def test_no_bar_shows_when_it_is_not_wanted_or_nobody_looks_on(capfd):
    run(False)
    run(None)
    shown = capfd.readouterr()
    assert shown.err == ""
    assert shown.out == ""


def test_a_long_piece_of_work_shows_its_bar_to_a_person(capfd, monkeypatch):
    import slidax.simulation.engine as module

    monkeypatch.setattr(module.sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(module, "PATIENCE", -1.0)
    with Progress(3, shown=None) as bar:
        assert bar._bar is None
        bar.advance()
        assert bar._bar is not None


def test_a_short_piece_of_work_shows_none_even_to_a_person(monkeypatch):
    import slidax.simulation.engine as module

    monkeypatch.setattr(module.sys.stderr, "isatty", lambda: True)
    with Progress(2, shown=None) as bar:
        bar.advance()
        assert bar._bar is None


def test_the_bar_changes_no_bit():
    for a, b in zip(jax.tree.leaves(run(True).tally), jax.tree.leaves(run(False).tally), strict=True):
        np.testing.assert_array_equal(a, b)
