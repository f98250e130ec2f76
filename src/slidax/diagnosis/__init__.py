"""Why a run left its envelope: causes that its log shows, each with the numbers and a remedy that was tried."""

from .cause import AbstractCause as AbstractCause
from .cause import Finding as Finding
from .cause import Remedy as Remedy
from .explain import CAUSES as CAUSES
from .explain import Explained as Explained
from .explain import explain as explain
from .record import Record as Record
