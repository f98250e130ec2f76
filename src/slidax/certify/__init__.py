"""Certificates: guarantees for a scenario before it runs.

`certify` runs all certificates of a scenario. Each returns a `Verdict`: whether the guarantee holds, the bound, the
margin, the assumptions and their grade, and remedies. A certificate covers all members of the scenario's uncertainty
set, or names what it does not cover.

`loop` bounds the tracking error at the sampling rate, `arm` the torques and inertias of all members, and `printed`
the continuous-time guarantees of laws in printed form. `motion` bounds the error along any motion, of an
arm that is known to within a set. `statistical.py` bounds the failure rate from random runs.

Read first: `certificate.py`, `certify.py`, `loop/loop_rate.py`.
"""

from .admissibility import admissibility as admissibility
from .certificate import Assumption as Assumption
from .certificate import Certificate as Certificate
from .certificate import Status as Status
from .certificate import Verdict as Verdict
from .certify import CERTIFICATES as CERTIFICATES
from .certify import Certificates as Certificates
from .certify import certify as certify
from .statistical import statistical as statistical
