"""The examples of the paper on approximate continuous fixed-time terminal sliding mode control, computed again.

Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w. One command does it all: `slidax reproduce`.
"""

from .printed import DOI as DOI
from .printed import TITLE as TITLE
from .reproduce import reproduce as reproduce
from .verdicts import Verdict as Verdict
from .verdicts import below as below
from .verdicts import compare as compare
