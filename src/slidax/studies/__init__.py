"""Studies: many runs of a scenario with uncertain values or with gains to choose.

A study is a YAML file (`files.py`) with one of six kinds: `monte_carlo`, `sweep`, `falsify`, `sensitivity`, `tune`,
`compare`. Each kind has its own file. Begin with `study.py`, the base of all kinds, then read `cases.py` (from values
to rows) and `runner.py` (where and when rows are computed). `search.py`, `pareto.py` and `statistics.py` are
independent of robots. `benchmark/` ranks control schemes on common tasks. Results are data, drawn by `slidax.report`.
"""

from .cases import Cases as Cases
from .cluster import Cluster as Cluster
from .files import AnyStudy as AnyStudy
from .files import frame as frame
from .files import read_study as read_study
from .files import scenario_of_row as scenario_of_row
from .files import study_of as study_of
from .monte_carlo import MonteCarlo as MonteCarlo
from .monte_carlo import MonteCarloResult as MonteCarloResult
from .predicates import Predicate as Predicate
from .runner import LocalPool as LocalPool
from .runner import Part as Part
from .runner import PartDone as PartDone
from .store import read_rows as read_rows
from .study import AbstractResult as AbstractResult
from .study import AbstractStudy as AbstractStudy
from .study import Chart as Chart
from .study import RunOptions as RunOptions
from .study import Section as Section
