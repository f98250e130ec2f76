"""Base class of parts, the declaration of their parameters, checks, and types of arrays.

A part is a frozen, differentiable piece of a closed loop: a surface, a reaching law, a robot. Each of its parameters is
declared once, in the class, by `parameter`. Docstrings, checks, scenario files with their JSON schema, `slidax list`,
reports and the comments of exported C are derived from there; see docs/extending.md.
"""

from slidax._errors import DefinitionError as DefinitionError
from slidax._errors import as_array as as_array
from slidax._errors import is_traced as is_traced
from slidax._errors import known as known
from slidax._errors import located as located
from slidax._errors import require as require
from slidax._errors import require_joints as require_joints
from slidax._errors import require_per_joint as require_per_joint
from slidax._errors import shown as shown
from slidax._types import Matrix as Matrix
from slidax._types import Memory as Memory
from slidax._types import PerJoint as PerJoint
from slidax._types import Scalar as Scalar
from slidax._types import State as State
from slidax._types import Vector as Vector

from .kinds import kind_of as kind_of
from .kinds import members_of as members_of
from .parameter import REQUIRED as REQUIRED
from .parameter import Parameter as Parameter
from .parameter import parameter as parameter
from .parameter import parameters_of as parameters_of
from .parameter import piece as piece
from .part import AbstractPart as AbstractPart
from .range import Range as Range
