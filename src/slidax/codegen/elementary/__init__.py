"""Elementary functions written out in exactly rounded operations, which give the same bits everywhere."""

from .written_out import written_out as written_out
