"""Robots in a scenario file."""

from typing import Annotated

from pydantic import Field

from .arms import Arms as Arms
from .articulated import Gen3Description, Iiwa14Description, PandaDescription, Ur5eDescription, Xarm7Description
from .files import MjcfDescription, UrdfDescription
from .paper import ScaraDescription, TwoLinkDescription

RobotDescription = Annotated[
    TwoLinkDescription
    | ScaraDescription
    | PandaDescription
    | Ur5eDescription
    | Iiwa14Description
    | Xarm7Description
    | Gen3Description
    | UrdfDescription
    | MjcfDescription,
    Field(discriminator="kind"),
]
