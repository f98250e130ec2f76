"""Design: from requirements to a controller with a certificate, or to the reason why none exists.

Begin with `problem.py`, the requirements file, and `design.py`, the steps from requirements to a scenario.
`candidates.py` has the searched values and the scenario for them, `trials.py` simulates candidates in common cases,
`search.py` chooses among them, `proof.py` computes their certificates, and `refusal.py` explains why no design exists.
"""

from .design import Design as Design
from .design import DesignResult as DesignResult
from .design import design as design
from .problem import DesignProblem as DesignProblem
from .problem import Requirements as Requirements
from .problem import read_problem as read_problem
from .refusal import Refusal as Refusal
