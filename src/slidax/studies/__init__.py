"""Studies: many runs of a scenario whose values are uncertain, or are still to be chosen."""

from .cases import Cases as Cases
from .file import AnyStudy as AnyStudy
from .file import read_study as read_study
from .file import study_of as study_of
from .frames import frame as frame
from .monte_carlo import MonteCarlo as MonteCarlo
from .monte_carlo import MonteCarloResult as MonteCarloResult
from .predicate import Predicate as Predicate
from .replay import scenario_of_row as scenario_of_row
from .result import AbstractResult as AbstractResult
from .result import Drawn as Drawn
from .result import Section as Section
from .runner import Here as Here
from .runner import Part as Part
from .runner import PartDone as PartDone
from .store import read_rows as read_rows
from .study import AbstractStudy as AbstractStudy
from .study import How as How
