"""Elementary functions written out in exactly rounded operations, which give the same bits everywhere."""

from .lowering import lower as lower
