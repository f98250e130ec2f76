"""Measurements of `make bench`. Times depend on the machine, so they are written down, never asserted."""
