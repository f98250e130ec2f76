"""Basic types, parameters, checks and small numerics that every subpackage uses.

A part (`AbstractPart`) is an immutable, differentiable component of a control loop: a surface, a reaching law, a robot.
Each parameter is declared once, in the part's class, by `parameter`. Docstrings, checks, the JSON schema of scenario
files, `slidax list`, reports and the comments of exported C are derived from the declaration; see docs/your-own-law.md.

Read first: `types.py` (State, Reference, Envelope, Command, Timing), `parameter.py`, `part.py`.
"""

from .errors import DefinitionError as DefinitionError
from .errors import DefinitionWarning as DefinitionWarning
from .errors import OutcomeError as OutcomeError
from .errors import as_array as as_array
from .errors import is_traced as is_traced
from .errors import locate_errors as locate_errors
from .errors import require as require
from .errors import require_joints as require_joints
from .errors import require_per_joint as require_per_joint
from .errors import short_repr as short_repr
from .errors import static_value as static_value
from .integrators import runge_kutta_4 as runge_kutta_4
from .integrators import semi_implicit_euler as semi_implicit_euler
from .integrators import value_rate_curvature as value_rate_curvature
from .linear_algebra import inverse_norm as inverse_norm
from .linear_algebra import is_positive_definite as is_positive_definite
from .linear_algebra import matvec as matvec
from .linear_algebra import nearest_in_box as nearest_in_box
from .linear_algebra import solve_symmetric as solve_symmetric
from .parameter import REQUIRED as REQUIRED
from .parameter import Parameter as Parameter
from .parameter import Range as Range
from .parameter import parameter as parameter
from .parameter import parameters_of as parameters_of
from .parameter import piece as piece
from .part import AbstractPart as AbstractPart
from .part import kind_of as kind_of
from .part import members_of as members_of
from .powers import linear_core_power_and_slope as linear_core_power_and_slope
from .powers import power as power
from .powers import saturation as saturation
from .powers import sig as sig
from .powers import sig_and_slope as sig_and_slope
from .powers import smooth_power as smooth_power
from .powers import smooth_power_and_slope as smooth_power_and_slope
from .powers import tangent_mask as tangent_mask
from .powers import two_term_power_and_slope as two_term_power_and_slope
from .powers import unit_vector as unit_vector
from .powers import vector_norm as vector_norm
from .root_finding import increasing_root as increasing_root
from .tracing import barrier as barrier
from .tracing import require_64_bits as require_64_bits
from .tracing import select as select
from .types import Command as Command
from .types import Envelope as Envelope
from .types import Matrix as Matrix
from .types import Memory as Memory
from .types import PerJoint as PerJoint
from .types import Reference as Reference
from .types import Scalar as Scalar
from .types import State as State
from .types import Timing as Timing
from .types import Vector as Vector
