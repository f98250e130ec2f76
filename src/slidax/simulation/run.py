"""Run: the result of a simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from slidax._errors import DefinitionError, is_traced
from slidax._types import Envelope, Reference, Scalar, State

from .columns import columns_of
from .excursion import Excursion
from .frames import Kind, data_frame
from .free_body import FreeBody
from .outcome import Fault, Outcome, describe
from .tally import Tally, Windows

Anyhow: TypeAlias = Array | np.ndarray
"""An array of JAX inside a transformation, of NumPy in a finished run."""


class Log(eqx.Module):
    """Logged samples; every array has the sample as its first axis.

    - `k`: number of the sample.
    - `t`: time [s].
    - `state`: the true state, not the measured one.
    - `reference`, `envelope`: as the controller had them; `envelope` is None for a scheme without one.
    - `tau`: torque after the actuator's limits [N m or N]; the previous torque where a sample was lost.
    - `signals`: the controller's inner quantities by name; where a sample was lost, those of the unused command.
    - `valid`: False for rows after the end of the run, which only a batch has.
    """

    k: Int[Anyhow, "..."]
    t: Float[Anyhow, "..."]
    state: State
    reference: Reference
    tau: Float[Anyhow, "..."]
    signals: Mapping[str, Float[Anyhow, "..."]]
    envelope: Envelope | None
    valid: Bool[Anyhow, "..."]

    @property
    def e(self) -> Float[Anyhow, "..."]:
        """Error `q - q_d`, rad or m."""
        return self.state.q - self.reference.q

    @property
    def de(self) -> Float[Anyhow, "..."]:
        """Velocity error `q̇ - q̇_d`, rad/s or m/s."""
        return self.state.dq - self.reference.dq

    def without_padding(self) -> Log:
        """The log of a single run, with its valid samples only."""
        valid = np.asarray(self.valid)
        return jax.tree.map(lambda x: np.asarray(x)[valid], self)


class Timing(NamedTuple):
    """Computing time of a run.

    - `compile_s`: tracing and compiling [s]; near 0 for the second run with equal shapes.
    - `run_s`: the run itself [s].
    """

    compile_s: float
    run_s: float


class Run(eqx.Module):
    """A finished simulation, or many from `simulate_batch`, whose arrays have the run as their first axis.

    Many runs have a length, `runs[i]` is one of them, and `for run in runs` iterates over them.

    - `log`: the logged samples; None without a log.
    - `tally`: statistics of all samples, which the metrics read.
    - `windows`: first sample of each statistic, and the settling bands.
    - `fault`: the first fault, as arrays; see `outcome`.
    - `excursion`: samples outside the envelope, as arrays; None if the first of them ends a run.
    - `state`: the state at the last good sample.
    - `period`: time between samples [s].
    - `t1`: requested end [s].
    - `has_envelope`: True if the scheme has an envelope.
    - `timing`: None inside a transformation.
    - `load`: motion of a released payload; only with a `MujocoPlant`.
    """

    log: Log | None
    tally: Tally
    windows: Windows
    fault: Fault
    excursion: Excursion | None
    state: State
    period: Scalar
    t1: Scalar
    joint_units: tuple[str, ...] = eqx.field(static=True)
    joint_names: tuple[str, ...] = eqx.field(static=True)
    has_envelope: bool = eqx.field(static=True)
    timing: Timing | None = eqx.field(static=True, default=None)
    load: FreeBody | None = None

    @property
    def joints(self) -> int:
        return len(self.joint_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: "N m" for a revolute joint, "N" for a prismatic one."""
        return tuple("N m" if unit == "rad" else "N" for unit in self.joint_units)

    @property
    def outcome(self) -> Outcome:
        """Outcome of a single run.

        Raises DefinitionError for many runs, which have `outcomes`, and inside a transformation.
        """
        if self.period.ndim:
            raise DefinitionError(f"these are {len(self)} runs: see `outcomes`, or the `outcome` of each, as `runs[0]`")
        if is_traced(self.fault):
            raise DefinitionError("inside `jit`, `vmap` and `grad` there is no outcome yet: look at `fault`")
        return describe(
            self.fault,
            self.excursion,
            int(self.tally.violations),
            float(self.period),
            self.joint_units,
            self.joint_names,
        )

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcome of each run; one entry for a single run."""
        if not self.period.ndim:
            return [self.outcome]
        ends = jax.tree.map(np.asarray, (self.fault, self.excursion, self.tally.violations, self.period))
        each = (jax.tree.map(lambda x, k=k: x[k], ends) for k in range(len(self)))
        return [
            describe(fault, excursion, int(outside), float(period), self.joint_units, self.joint_names)
            for fault, excursion, outside, period in each
        ]

    def __len__(self) -> int:
        """The number of runs; only many have one."""
        if not self.period.ndim:
            raise TypeError("a single run has no length; `simulate_batch` returns many")
        return int(self.period.shape[0])

    def __bool__(self) -> bool:
        """True, whatever the outcome."""
        return True

    def __getitem__(self, which: int | slice) -> Run:
        """One of many runs, with its valid samples only; or several, by a slice."""
        if isinstance(which, slice):
            return _picked(self, which)
        count = len(self)
        if not -count <= which < count:
            raise IndexError(f"there are {count} runs; got {which}")
        run = _picked(self, which)
        if run.log is None or run.period.ndim or is_traced(run.log):
            return run
        return eqx.tree_at(lambda run: run.log, run, run.log.without_padding())

    def __iter__(self) -> Iterator[Run]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        # Imported late: `overview` needs `Run`.
        from .overview import as_text

        return as_text(self) if self._is_known else eqx.tree_pformat(self)

    def _repr_html_(self) -> str | None:
        """HTML for a notebook."""
        from .overview import as_html

        return as_html(self) if self._is_known else None

    @property
    def _is_known(self) -> bool:
        kind = self.fault.kind
        return isinstance(kind, jax.Array | np.ndarray | np.generic) and not is_traced(self) and self.period.ndim < 2

    def frame(self, kind: Kind = "pandas", joints: Literal["names", "numbers"] = "names") -> Any:
        """The log as a data frame: a row per sample, columns such as `q[panda_joint1]`; pandas has units in `attrs`.

        - `joints`: "names" for `q[panda_joint1]`, "numbers" for `q_1`, as in Parquet logs.

        Raises DefinitionError without a log, for many runs, or if the library is not installed.
        """
        columns = self._columns(joints)
        units = {name: unit for name, (_, unit) in columns.items()}
        return data_frame({name: values for name, (values, _) in columns.items()}, kind, units)

    def units(self, joints: Literal["names", "numbers"] = "names") -> dict[str, str]:
        """Units of the columns of `frame`, by name. Raises DefinitionError as `frame` does."""
        return {name: unit for name, (_, unit) in self._columns(joints).items()}

    def _columns(self, joints: str) -> dict[str, tuple[np.ndarray, str]]:
        if joints not in ("names", "numbers"):
            raise DefinitionError(f'`joints` must be "names" or "numbers"; got "{joints}"')
        named = joints == "names"
        return columns_of(self, [f"[{name}]" if named else f"_{k + 1}" for k, name in enumerate(self.joint_names)])


def _picked(run: Run, which: int | slice) -> Run:
    # By NumPy: JAX would compile a slice for each shape.
    return jax.tree.map(lambda x: x[which] if is_traced(x) else np.asarray(x)[which, ...], run)
