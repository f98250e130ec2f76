"""Sliding-mode control of robot arms in JAX. A control law is written once, then simulated, certified and exported.

    import slidax as sx

    scenario = sx.scenarios.load("example-4.1")
    run = scenario.simulate()

Importing slidax makes JAX compute with 64 bits, unless `JAX_ENABLE_X64` is set or JAX has arrays already.

The subpackages, from the bottom up; each is imported when it is first used:

- `core` (types, parameters, checks) and `codegen` (C, machine code and WebAssembly from JAX functions);
- `arms`, `motions` (references), `plant` (sensors, drives, disturbances) and `law` (controllers);
- `simulation` (the closed loop), `scenarios` (a closed loop as a YAML file), `identify` (an arm from a log);
- `analysis` (metrics), `certify` (guarantees), `studies` (many runs, tuning), `design` (a law from requirements);
- `report` (figures and pages), `paper` (reproduction), `export` (C code), `runtime` (laws on robots), `studio`, `cli`.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from slidax import analysis as analysis
    from slidax import arms as arms
    from slidax import certify as certify
    from slidax import codegen as codegen
    from slidax import core as core
    from slidax import design as design
    from slidax import identify as identify
    from slidax import law as law
    from slidax import motions as motions
    from slidax import paper as paper
    from slidax import plant as plant
    from slidax import report as report
    from slidax import runtime as runtime
    from slidax import scenarios as scenarios
    from slidax import simulation as simulation
    from slidax import studies as studies
    from slidax.analysis import metrics as metrics
    from slidax.core import Command as Command
    from slidax.core import DefinitionError as DefinitionError
    from slidax.core import DefinitionWarning as DefinitionWarning
    from slidax.core import Envelope as Envelope
    from slidax.core import OutcomeError as OutcomeError
    from slidax.core import Reference as Reference
    from slidax.core import State as State
    from slidax.report import figures as figures
    from slidax.scenarios import new as new
    from slidax.simulation import MujocoPlant as MujocoPlant
    from slidax.simulation import Plant as Plant
    from slidax.simulation import Run as Run
    from slidax.simulation import Stepping as Stepping
    from slidax.simulation import simulate as simulate
    from slidax.simulation import simulate_batch as simulate_batch

__version__ = "0.1.0"

_EXPORTED = {
    "export": ("load_export",),
    "core": ("Command", "DefinitionError", "DefinitionWarning", "Envelope", "OutcomeError", "Reference", "State"),
    "scenarios": ("new",),
    "simulation": ("MujocoPlant", "Plant", "Run", "Stepping", "simulate", "simulate_batch"),
}
_HOME = {name: package for package, names in _EXPORTED.items() for name in names}
_SHORT = {"figures": "report.figures", "metrics": "analysis.metrics"}
"""Modules that are used after nearly every run, under a short name."""
_SUBPACKAGES = [module.name for module in iter_modules(__path__) if not module.name.startswith("_")]


def _enable_64_bits() -> None:
    """Enable 64-bit numbers in JAX unless the user has decided otherwise."""
    jax = sys.modules.get("jax")
    if jax is None:
        # JAX reads this variable when it is imported. slidax imports JAX at the first use only, since it takes a while.
        os.environ.setdefault("JAX_ENABLE_X64", "1")
    elif "JAX_ENABLE_X64" not in os.environ and not jax.live_arrays():
        jax.config.update("jax_enable_x64", True)


_enable_64_bits()


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    if name in _SUBPACKAGES or name in _SHORT:
        return import_module(f".{_SHORT.get(name, name)}", __name__)
    raise AttributeError(f"module `slidax` has no `{name}`")


def __dir__() -> list[str]:
    return sorted([*_SUBPACKAGES, *_SHORT, *_HOME, "__version__"])
