"""Elementary functions expanded into correctly rounded operations, for bitwise equal results everywhere."""

from .lowering import lower as lower
