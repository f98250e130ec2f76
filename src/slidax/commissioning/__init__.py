"""First scenario for an arm: drive ratings with assumptions, a home posture and a motion."""

from .scenario import Drafted as Drafted
from .scenario import draft as draft
