"""What is promised of a scenario before it runs: each certificate is a Verdict with its bound and its assumptions."""

from .verdict import Assumption as Assumption
from .verdict import Status as Status
from .verdict import Verdict as Verdict
