"""Arms read from robot files: URDF, and MJCF as MuJoCo has it."""

from .mjcf import from_mjcf as from_mjcf
from .urdf import from_urdf as from_urdf
