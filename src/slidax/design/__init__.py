"""From requirements to a law: what the arm, its motion and its uncertainty ask for, or why it cannot be had."""

from .design import Design as Design
from .design import Designed as Designed
from .design import design as design
from .refusal import Refused as Refused
from .requirements import DesignProblem as DesignProblem
from .requirements import Requirements as Requirements
from .requirements import read_problem as read_problem
