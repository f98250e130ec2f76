"""Programs as readable C99.

`functions.py` prints a whole function, `writer.py` its statements; `rerolling.py` writes similar statements as loops.
"""

from .expressions import Dialect as Dialect
from .expressions import Helpers as Helpers
from .functions import Statements as Statements
from .functions import statements as statements
from .placement import loop_invariant as loop_invariant
from .writer import Callee as Callee
