"""What is certified of an arm and its set: constants, what its motion asks of the loops, and of the drives."""

from .demand import demand as demand
