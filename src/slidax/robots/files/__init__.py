"""Arms read from robot files: URDF, and MJCF as MuJoCo has it."""

from .mjcf import from_mjcf as from_mjcf
from .urdf import from_urdf as from_urdf
from .urdf_drawn import Drawn as Drawn
from .urdf_drawn import Shape as Shape
from .urdf_drawn import drawn as drawn
