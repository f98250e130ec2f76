"""The studies that the documentation shows can be asked."""

import warnings
from pathlib import Path

import pytest

from slidax.core.errors import DefinitionWarning
from slidax.studies import read_study

FILES = sorted((Path(__file__).parents[2] / "examples" / "studies").glob("*.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_example_is_a_study_of_sets_that_exist(path):
    study = read_study(path)
    assert study.title
    if study.study == "sweep":
        # A map may go where a warning is due.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DefinitionWarning)
            assert len(study.over) == study._family().space.dimensions == 2
        return
    family = study.family(study.gains) if study.study == "tune" else study.family()
    assert family.space.dimensions > 3
