"""Reproduction of the paper on fixed-time terminal sliding mode control with prescribed performance.

Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w. `slidax reproduce` runs `reproduce.py`. Begin with
`examples.py`, which has the schemes and runs, and `printed.py`, which has the printed values and the rule for verdicts.
`numbers.py` and `claims.py` compare, `figures.py` draws.
"""

from .printed import DOI as DOI
from .printed import TITLE as TITLE
from .printed import PrintedComparison as PrintedComparison
from .printed import compare_limit as compare_limit
from .printed import compare_printed as compare_printed
from .reproduce import reproduce as reproduce
