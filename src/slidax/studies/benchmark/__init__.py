"""Benchmark of schemes: common tasks, a common tuner, and scores on held-out cases.

Begin with `entries.py`: a task is a file in `tasks/`, an entry is a scheme in one form, and `gains.yaml` lists the
gains to tune. A form is `sampled-data`, for a fixed sample time, or `printed`, the law as published. `rounds.py` tunes
and scores all entries, `ranking.py` compares them. `slidax.report` writes the page.
"""

from .entries import VERSION as VERSION
from .entries import BenchmarkEntry as BenchmarkEntry
from .entries import BenchmarkTask as BenchmarkTask
from .entries import entries as entries
from .entries import forms_of as forms_of
from .entries import names as names
from .entries import task as task
from .ranking import Ranking as Ranking
from .ranking import Score as Score
from .ranking import ranking as ranking
from .rounds import BenchmarkRound as BenchmarkRound
from .rounds import RoundResults as RoundResults
from .rounds import TaskResult as TaskResult
