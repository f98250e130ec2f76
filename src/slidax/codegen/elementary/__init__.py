"""Elementary functions in correctly rounded operations, which give the same bits on every machine."""

from .lowering import lower as lower
