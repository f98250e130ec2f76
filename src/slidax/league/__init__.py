"""Benchmark of schemes: common tasks, one tuner for all, and scores on cases that no tuner has seen."""

from .entry import BenchmarkEntry as BenchmarkEntry
from .entry import entries as entries
from .entry import forms_of as forms_of
from .match import TaskResult as TaskResult
from .page import write_benchmark as write_benchmark
from .season import BenchmarkRound as BenchmarkRound
from .season import RoundResults as RoundResults
from .standing import Ranking as Ranking
from .standing import Score as Score
from .standing import ranking as ranking
from .task import VERSION as VERSION
from .task import BenchmarkTask as BenchmarkTask
from .task import names as names
from .task import task as task
