"""Which numbers matter: the shares of a result's variance that are theirs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, shown


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of one result (I. M. Sobol', Math. Comput. Simul. 55, 2001).

    - `first`: what each group of numbers does by itself [groups].
    - `total`: what it does by itself and together with others [groups].
    - `first_half`, `total_half`: half the widths of their intervals [groups].
    - `confidence`: of the intervals.
    - `variance`: of the result; where it is 0 all shares are 0, too.
    """

    first: np.ndarray
    total: np.ndarray
    first_half: np.ndarray
    total_half: np.ndarray
    confidence: float
    variance: float


def points_for_indices(groups: Sequence[int], base: int, *, seed: int = 0) -> np.ndarray:
    """Points at which a result must be known, by Saltelli's rule [base (groups + 2), dimension].

    - `groups`: how many coordinates of the cube belong together, for each thing whose share is asked for.
    - `base`: a power of two, from some hundreds on.
    - `seed`: of the scrambling.

    Raises DefinitionError if the base is no power of two, or SALib is not installed.
    """
    if base < 2 or base & (base - 1):
        raise DefinitionError(f"`base` must be a power of two, as 512; got {shown(base)}")
    salib = _salib()
    return salib[0].sample(_problem(groups), base, calc_second_order=False, scramble=True, seed=seed)


def sobol_indices(
    results: np.ndarray, groups: Sequence[int], *, confidence: float = 0.95, seed: int = 0
) -> SobolIndices:
    """The indices of one result, by SALib, with intervals from 100 resamples.

    - `results`: at all `points_for_indices`, in their order [base (groups + 2)].
    - `groups`: as there.
    - `confidence`: of the intervals.
    - `seed`: of the resamples.

    Raises DefinitionError if a result is missing or not finite, or SALib is not installed.
    """
    results = np.asarray(results, float)
    if results.ndim != 1 or len(results) % (len(groups) + 2):
        raise DefinitionError(f"`results` must be at all points of the design; got {shown(results.shape)}")
    wrong = int(np.sum(~np.isfinite(results)))
    if wrong:
        raise DefinitionError(f"{wrong} of {len(results)} results are not finite: indices need them all")
    if np.ptp(results) == 0.0:
        nothing = np.zeros(len(groups))
        return SobolIndices(nothing, nothing, nothing, nothing, confidence, 0.0)
    # SALib takes NumPy's global random numbers where its seed is 0.
    result = _salib()[1].analyze(
        _problem(groups), results, calc_second_order=False, conf_level=confidence, seed=seed + 1
    )
    first, total, first_half, total_half = (np.asarray(result[key]) for key in ("S1", "ST", "S1_conf", "ST_conf"))
    return SobolIndices(first, total, first_half, total_half, confidence, float(results.var()))


def _problem(groups: Sequence[int]) -> dict[str, Any]:
    """The problem definition of SALib; the coordinates of a group are drawn anew together."""
    dimension = sum(groups)
    result: dict[str, Any] = {
        "num_vars": dimension,
        "names": [f"x{k}" for k in range(dimension)],
        "bounds": [[0.0, 1.0]] * dimension,
    }
    if dimension > len(groups):
        result["groups"] = [f"group {k}" for k, width in enumerate(groups) for _ in range(width)]
    return result


def _salib() -> tuple[Any, Any]:
    try:
        from SALib.analyze import sobol as analyze
        from SALib.sample import sobol as sample
    except ImportError:
        raise DefinitionError(
            "Sobol indices need SALib, which is not installed: pip install 'slidax[studies]'"
        ) from None
    return sample, analyze
