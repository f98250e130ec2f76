"""Sliding-mode control of robot arms in JAX: one law, written once, simulated, batched, differentiated.

    import jax
    jax.config.update("jax_enable_x64", True)
    import slidax as sx

    scenario = sx.scenarios.load("example-4.1")
    run = scenario.simulate()

The rooms are `trajectories`, `robots`, `disturbances`, `sensors`, `actuators` (the world); `kinematics` (from what a
tool should do to what the joints should); `performance`,
`transformations`, `surfaces`, `reaching`, `estimators`, `adaptation`, `controllers` (the law); `simulation` (the loop);
`identification` (an arm's numbers from a log); `scenarios`; `metrics`, `figures`, `papers`, `reports`, `diagnosis`,
`certificates` (the judgement). Each is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import actuators as actuators
    from . import adaptation as adaptation
    from . import certificates as certificates
    from . import controllers as controllers
    from . import disturbances as disturbances
    from . import estimators as estimators
    from . import figures as figures
    from . import identification as identification
    from . import kinematics as kinematics
    from . import linear as linear
    from . import metrics as metrics
    from . import numerics as numerics
    from . import papers as papers
    from . import parts as parts
    from . import performance as performance
    from . import reaching as reaching
    from . import reports as reports
    from . import robots as robots
    from . import scenarios as scenarios
    from . import sensors as sensors
    from . import simulation as simulation
    from . import surfaces as surfaces
    from . import trajectories as trajectories
    from . import transformations as transformations
    from . import views as views
    from ._errors import DefinitionError as DefinitionError
    from ._errors import DefinitionWarning as DefinitionWarning
    from ._errors import OutcomeError as OutcomeError
    from ._types import Command as Command
    from ._types import Envelope as Envelope
    from ._types import Reference as Reference
    from ._types import State as State
    from .certificates import certify as certify
    from .simulation import MujocoPlant as MujocoPlant
    from .simulation import Plant as Plant
    from .simulation import Run as Run
    from .simulation import Stepping as Stepping
    from .simulation import simulate as simulate
    from .simulation import simulate_batch as simulate_batch

__version__ = "0.1.0"

_EXPORTED = {
    "_errors": ("DefinitionError", "DefinitionWarning", "OutcomeError"),
    "_types": ("Command", "Envelope", "Reference", "State"),
    "certificates": ("certify",),
    "simulation": ("MujocoPlant", "Plant", "Run", "Stepping", "simulate", "simulate_batch"),
}
_ROOM_OF = {name: room for room, names in _EXPORTED.items() for name in names}
_ROOMS = [room.name for room in iter_modules(__path__) if not room.name.startswith("_")]


def __getattr__(name: str) -> Any:
    if name in _ROOM_OF:
        return getattr(import_module(f".{_ROOM_OF[name]}", __name__), name)
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module `slidax` has no `{name}`")


def __dir__() -> list[str]:
    return sorted([*_ROOMS, *_ROOM_OF, "__version__"])
