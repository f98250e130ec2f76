"""Why a run left its envelope: causes that its log shows, each with the numbers and a remedy that was tried."""

from .beforehand import beforehand as beforehand
from .cause import AbstractCause as AbstractCause
from .cause import Finding as Finding
from .cause import Remedy as Remedy
from .explained import CAUSES as CAUSES
from .explained import Answer as Answer
from .explained import explained as explained
from .explained import first_line as first_line
from .record import Record as Record
from .record import require_explainable as require_explainable
from .saved import read_saved as read_saved
