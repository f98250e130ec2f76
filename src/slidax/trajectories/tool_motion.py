"""A joint motion that moves a tool along a path."""

from __future__ import annotations

from .piecewise_polynomial import AbstractPiecewisePolynomial


class ToolMotion(AbstractPiecewisePolynomial):
    """A joint motion by `slidax.kinematics.follow`, at rest before and after; runs also record the tool's error."""
