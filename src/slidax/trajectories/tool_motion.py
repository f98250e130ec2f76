"""A motion of the joints that leads a tool along a path."""

from __future__ import annotations

from .piecewise_polynomial import AbstractPiecewisePolynomial


class ToolMotion(AbstractPiecewisePolynomial):
    """As `slidax.kinematics.follow` finds it; what counts is the tool, so that a run with it tallies the tool's error.

    Before the first knot and after the last it stands still.
    """
