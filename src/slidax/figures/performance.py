"""Performance functions."""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from slidax._errors import DefinitionError
from slidax.performance import AbstractPerformance

from .axes import use_time_axis
from .style import LINES, legend_above, styled
from .thinning import every_nth


@styled
def performance(functions: Mapping[str, AbstractPerformance], t: np.ndarray) -> Figure:
    """Performance functions ρ(t) on a logarithmic axis.

    - `functions`: of one joint, by name.
    - `t`: times [k], s.

    Raises DefinitionError if there are none, more than five, or one with several joints.
    """
    if not 1 <= len(functions) <= len(LINES):
        raise DefinitionError(f"this figure shows 1 to {len(LINES)} functions; got {len(functions)}")
    figure = Figure(figsize=(6.2, 3.1), layout="constrained")
    axes = figure.subplots()
    times = jnp.asarray(t, float)
    lines = []
    for (name, function), line in zip(functions.items(), LINES, strict=False):
        radius = np.asarray(jax.vmap(function.radius)(times))
        if radius.ndim != 1:
            raise DefinitionError(f"`{name}` has {radius.shape[1]} joints; give one function per joint")
        lines += axes.plot(every_nth(np.asarray(t)), every_nth(radius), **line, label=name)
    axes.set_yscale("log")
    use_time_axis(axes, float(t[0]), float(t[-1]))
    axes.set_ylabel(r"$\rho$  [rad or m]")
    legend_above(figure, lines, columns=None if len(lines) < 5 else 3)
    return figure
