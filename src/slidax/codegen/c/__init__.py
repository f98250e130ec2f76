"""Programs as readable C99."""

from .dialect import Dialect as Dialect
from .helpers import Helpers as Helpers
from .loop_invariant import loop_invariant as loop_invariant
from .statements import Statements as Statements
from .statements import statements as statements
from .writer import Callee as Callee
