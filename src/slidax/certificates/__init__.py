"""Certificates: guarantees for a scenario before it runs, each a `Verdict` with its bound and its assumptions."""

from .admissibility import admissibility as admissibility
from .certificate import Certificate as Certificate
from .certify import CERTIFICATES as CERTIFICATES
from .certify import Certificates as Certificates
from .certify import certify as certify
from .statistical import statistical as statistical
from .verdict import Assumption as Assumption
from .verdict import Status as Status
from .verdict import Verdict as Verdict
