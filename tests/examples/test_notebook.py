"""The notebook runs: its cells one after the other, and in marimo where that is installed."""

import ast
import runpy
from types import SimpleNamespace

import matplotlib as mpl
import pytest

from tests.documentation.pages import ROOT

NOTEBOOK = ROOT / "examples" / "notebooks" / "tune_a_law.py"


def assert_answers(names):
    assert names["run"].outcome.ok and len(names["errors"]) == len(names["gains"]) == 4
    assert float(names["value"]) > 0 and float(names["slope"]) != 0


@pytest.mark.full
def test_cells_of_the_notebook_run_in_their_order():
    """Widgets have their first values, and cells their place in the file; the gradient takes most of the time."""
    mpl.use("agg")
    ui = SimpleNamespace(slider=lambda *_, value, **__: SimpleNamespace(value=value), table=list)
    names = {"mo": SimpleNamespace(ui=ui, vstack=list, md=str, as_html=repr)}
    cells = [node for node in ast.parse(NOTEBOOK.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)]
    for cell in cells:
        kept = [line for line in cell.body if not isinstance(line, ast.Return) and "marimo" not in ast.unparse(line)]
        exec(compile(ast.Module(kept, []), str(NOTEBOOK), "exec"), names)
    assert_answers(names)


@pytest.mark.full
def test_the_notebook_runs_in_marimo():
    pytest.importorskip("marimo")
    mpl.use("agg")
    _, names = runpy.run_path(str(NOTEBOOK), run_name="notebook")["app"].run()
    assert_answers(names)
