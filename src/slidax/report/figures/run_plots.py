"""Plots of a run as methods: whole figures, or all joints in the caller's axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from slidax.analysis.metric import short_names
from slidax.simulation.run import Run

from .overlay import envelope_share
from .run import torque, tracking_error, velocity_error
from .style import log_of


@dataclass(frozen=True, eq=False)
class RunPlots:
    """The plots of a run with a log.

        run.plot.errors()                  # a figure with a row for each joint
        run.plot.errors(ax=ax)             # all joints in axes of your own

    Each returns the figure, or with `ax` these axes; `envelope` always returns the figure. Each raises DefinitionError
    if the run has no log.
    """

    run: Run

    def errors(self, ax: Axes | None = None) -> Any:
        """Draw the tracking errors, rad or m; without `ax` also the envelope."""
        return tracking_error(self.run) if ax is None else self._overlaid(ax, log_of(self.run).e, "error", "")

    def velocity_errors(self, ax: Axes | None = None) -> Any:
        """Draw the velocity errors, rad/s or m/s."""
        return (
            velocity_error(self.run) if ax is None else self._overlaid(ax, log_of(self.run).de, "velocity error", "/s")
        )

    def torques(self, ax: Axes | None = None) -> Any:
        """Draw the torques, N m or N."""
        if ax is None:
            return torque(self.run)
        return self._overlaid(ax, log_of(self.run).tau, "torque", None)

    def envelope(self, ax: Axes | None = None) -> Any:
        """Draw the error of each joint as a share of its envelope bound."""
        return envelope_share(self.run, ax=ax)

    def _overlaid(self, ax: Axes, values: Any, quantity: str, per: str | None) -> Axes:
        t = np.asarray(log_of(self.run).t)
        for joint, name in enumerate(short_names(self.run.joint_names)):
            ax.plot(t, np.asarray(values)[:, joint], label=name)
        own = self.run.torque_units if per is None else [f"{unit}{per}" for unit in self.run.joint_units]
        ax.set_xlabel("t [s]")
        ax.set_ylabel(f"{quantity} [{', '.join(dict.fromkeys(own))}]")
        return ax
