"""Read arms from robot files: URDF, also as xacro, and MJCF, MuJoCo's format.

Begin with `urdf.py` and `mjcf.py`. `source.py` reads the text with limits, `urdf_tree.py` and
`mjcf_checks.py` check it, and `find_arm.py` finds the arm in a file with grippers and other parts.
"""

from .mjcf import from_mjcf as from_mjcf
from .urdf import from_urdf as from_urdf
from .urdf_drawing import Shape as Shape
from .urdf_drawing import UrdfDrawing as UrdfDrawing
from .urdf_drawing import urdf_drawing as urdf_drawing
