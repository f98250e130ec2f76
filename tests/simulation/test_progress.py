"""The progress bar: shown on request or in long runs, and without effect on the results."""

import pytest

from slidax.simulation import engine, simulate
from tests.enrolled import assert_same
from tests.paper_examples import MOTION_4_1, START_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING


def run(progress):
    return simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, progress=progress)


def test_a_run_draws_its_progress_bar_on_standard_error_only(capfd):
    run(True)
    shown = capfd.readouterr()
    assert "simulating" in shown.err
    assert shown.out == ""


@pytest.mark.parametrize("progress", [False, None])
def test_a_run_without_a_terminal_or_with_progress_off_shows_no_progress_bar(capfd, progress):
    run(progress)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("patience", "steps"), [(-1.0, 3), (engine.PATIENCE, 2)], ids=["long", "short"])
def test_only_long_runs_show_a_progress_bar(monkeypatch, patience, steps):
    monkeypatch.setattr(engine.sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(engine, "PATIENCE", patience)
    with engine.Progress(steps, shown=None) as bar:
        assert bar._bar is None
        bar.advance()
        assert (bar._bar is not None) == (patience < 0)


def test_the_progress_bar_changes_no_bit():
    assert_same(run(True).tally, run(False).tally)
