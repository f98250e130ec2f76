"""A league: schemes on common tasks, tuned alike on some cases, and judged by others that they have not seen."""

from .entry import Entry as Entry
from .entry import entries as entries
from .entry import forms_of as forms_of
from .match import Match as Match
from .page import write_league as write_league
from .season import Results as Results
from .season import Season as Season
from .standing import Score as Score
from .standing import Standing as Standing
from .standing import standing as standing
from .task import VERSION as VERSION
from .task import LeagueTask as LeagueTask
from .task import names as names
from .task import task as task
