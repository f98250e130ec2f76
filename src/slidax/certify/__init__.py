"""Certificates: guarantees for a scenario before it runs.

`certify` runs all certificates of a scenario. Each returns a `Verdict`: whether the guarantee holds, the bound, the
margin, the assumptions and their grade, and remedies. A certificate covers all members of the scenario's uncertainty
set, or names what it does not cover.

`motion` bounds the tracking error along a motion of an arm that is known to within a set, `arm` the torques and
inertias of all members, and `printed` certifies laws in the form that the paper prints (Nonlinear Dynamics 2022,
doi 10.1007/s11071-022-07650-w). `statistical.py` bounds the failure rate from random runs.

Read first: `certificate.py`, `certify.py`, `motion/admission.py`.
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
