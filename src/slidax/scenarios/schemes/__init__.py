"""Control schemes in a scenario file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .classical import ComputedTorqueScheme, GravityPd, SlotineLiPpc, SlotineLiScheme, SuperTwistingScheme
from .fixed_time import Cftsmppc, Ftsmc, Ftsmppc
from .parts import AbstractSliding as AbstractSliding
from .performance import PerformanceDescription as PerformanceDescription
from .sampled_data import EstimatorDescription as EstimatorDescription
from .sampled_data import Sampling as Sampling
from .terminal import Anftsmc, Nftsmc, Sfsmc, Sfsmppc

SchemeDescription = Annotated[
    Cftsmppc
    | Ftsmppc
    | Ftsmc
    | Sfsmc
    | Sfsmppc
    | Nftsmc
    | Anftsmc
    | SlotineLiScheme
    | SlotineLiPpc
    | SuperTwistingScheme
    | ComputedTorqueScheme
    | GravityPd,
    Field(discriminator="name"),
]
