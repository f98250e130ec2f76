"""Figures that display themselves in a notebook, without pyplot."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from matplotlib import rc_context
from matplotlib.figure import Figure

Given = ParamSpec("Given")
Drawn = TypeVar("Drawn")


class NotebookFigure(Figure):
    """A Figure that a notebook shows as SVG, with the settings that it was made with."""

    settings: Any

    def _repr_svg_(self) -> str:
        buffer = io.StringIO()
        with rc_context(self.settings):
            self.savefig(buffer, format="svg")
        return buffer.getvalue()


def drawn_by(settings: Any) -> Callable[[Callable[Given, Drawn]], Callable[Given, Drawn]]:
    """Decorate a function that draws: matplotlib's `settings` hold inside, and the figure shows itself in notebooks."""

    def decorated(draw: Callable[Given, Drawn]) -> Callable[Given, Drawn]:
        @functools.wraps(draw)
        def drawn(*args: Given.args, **kwargs: Given.kwargs) -> Drawn:
            with rc_context(settings):
                figure: Any = draw(*args, **kwargs)
            if isinstance(figure, Figure):
                # Here, in the one place that all figures pass, and not where each is made.
                figure.__class__ = NotebookFigure
                figure.settings = settings  # type: ignore[attr-defined]
            return figure

        return drawn

    return decorated
