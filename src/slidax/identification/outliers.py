"""Positions that wrap at a whole turn, and single samples that are far from their neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from slidax.robots import Articulated

from .log import FEWEST, Log

WRAP = 0.5
"""A step between two samples within this distance of a whole turn is a wrapped angle [rad]."""

SPIKE = 30.0
"""A distance from the neighbours' median, as a multiple of the usual distance, that is a fault of the measurement."""

RANGE = 1.5
"""The same, as a share of the column's range without its extremes."""

MOST = 0.02
"""A share of the samples above which they are no single faults."""


def without_outliers(log: Log, robot: Articulated) -> tuple[Log, list[str]]:
    """The log with its angles unwrapped and without single faulty samples; and sentences on both."""
    warnings: list[str] = []
    q = log.q.copy()
    for joint, unit in enumerate(robot.joint_units):
        steps = np.diff(q[:, joint])
        if unit == "rad" and len(steps) and (np.abs(np.abs(steps) - 2.0 * np.pi) < WRAP).any():
            turns = np.where(np.abs(np.abs(steps) - 2.0 * np.pi) < WRAP, np.sign(steps), 0.0)
            around = 2.0 * np.pi * np.cumsum(np.concatenate([[0.0], turns]))
            # A spike of a whole turn goes and comes: what is left of a true wrap are long parts.
            if np.median(np.abs(np.diff(q[:, joint] - around))) <= np.median(np.abs(steps)) + 1e-12:
                q[:, joint] -= around
                warnings.append(
                    f"positions of {log.source} jump by a whole turn for joint `{log.joints[joint]}`: "
                    "they are unwrapped"
                )
    wrong = np.zeros(len(log.t), bool)
    for values in (q, log.tau, *([] if log.dq is None else [log.dq])):
        for column in values.T:
            apart = np.abs(column - ndimage.median_filter(column, 7, mode="nearest"))
            low, high = np.quantile(column, [0.01, 0.99])
            usual = np.quantile(apart, 0.9)
            wrong |= (apart > SPIKE * usual) & (apart > RANGE * (high - low)) & (high > low)
    count = int(wrong.sum())
    if not 0 < count <= MOST * len(wrong) or len(wrong) - count < FEWEST:
        return replace(log, q=q), warnings
    first = int(np.argmax(wrong))
    warnings.append(
        f"{count} samples of {log.source} are far from their neighbours, first sample {first + 1}: they are left out"
    )
    return replace(log, q=q).rows(~wrong), warnings
