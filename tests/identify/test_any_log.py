"""Any log of finite numbers is identified, with finite numbers, or refused in a line."""

from dataclasses import replace

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.identify import JointLog, identify
from tests.identify.spoiled import ARMS, clean_log


def damaged(log: JointLog, rng: np.random.Generator) -> JointLog:
    """A log after one to three changes by chance."""
    for _ in range(rng.integers(1, 4)):
        name = str(rng.choice(["t", "q", "tau", "dq"]))
        values = np.array(getattr(log, name) if getattr(log, name) is not None else log.q)
        columns = slice(None) if values.ndim == 1 else rng.integers(values.shape[1])
        own = values[..., columns] if values.ndim > 1 else values
        match rng.integers(9):
            case 0:
                own = own * 10.0 ** rng.integers(-12, 13)
            case 1:
                own = 0.0 * own + rng.normal()
            case 2:
                own = own + 10.0 ** rng.integers(-3, 7) * rng.normal(size=own.shape)
            case 3:
                own = np.roll(own, rng.integers(len(own)))
            case 4:
                own = own[::-1]
            case 5:
                own = np.round(own, rng.integers(-2, 3))
            case 6:
                own = np.where(rng.random(len(own)) < 0.01, 10.0 ** rng.integers(0, 9), own)
            case 7:
                own = np.repeat(own[:: int(rng.integers(2, 300))], 300)[: len(own)]
                own = np.resize(own, len(log.t))
            case _:
                own = rng.permutation(own)
        if values.ndim == 1:
            values = own
        else:
            values[:, columns] = own
        log = replace(log, **{name: values})
    keep = np.sort(rng.permutation(len(log.t))[: int(rng.integers(250, len(log.t)))])
    if rng.random() < 0.3:
        log = log.rows(keep)
    return log


def require_finite_or_refused(name: str, seeds: range) -> None:
    arm = ARMS[name]()
    clean = clean_log(arm, 0).rows(np.arange(2000))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        log = damaged(clean, rng)
        options = {"links": bool(rng.random() < 0.3), "asymmetric": bool(rng.random() < 0.3)}
        try:
            result = identify(log, arm, **options)
        except DefinitionError:
            continue
        numbers = [(parameter.value, parameter.standard_error) for parameter in result.parameters]
        assert np.isfinite(numbers).all(), seed
        assert np.isfinite([result.fit_rms, result.held_out_rms, result.measured_rms]).all(), seed


def test_damaged_logs_of_a_small_arm_are_refused_or_give_finite_numbers():
    require_finite_or_refused("two_link", range(6))


@pytest.mark.full
@pytest.mark.parametrize("name", ARMS)
def test_many_damaged_logs_are_refused_or_give_finite_numbers(name):
    require_finite_or_refused(name, range(100, 400 if name == "two_link" else 150))
