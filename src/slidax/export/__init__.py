"""Exports of a control law: a guarded step, as a C project for robots, ROS 2, microcontrollers, FMI and the browser.

Read `guarded_step` first: one sample of the law with checks of its inputs and results, as every export computes it.
`c_project` writes that step as C99 with tests. `admission` writes C code that accepts or rejects planned motions.
`robots`, `ros2`, `micro`, `fmu` and `web` put the step into a host. `onboard` holds the programs that run next to an
exported law without slidax. `lockstep` and `real_time_loop` run the step against a simulated arm.
"""

from .c_project import export_c as export_c
from .exported_law import ExportedLaw as ExportedLaw
from .exported_law import load_export as load_export
from .guarded_step import GuardedStep as GuardedStep
from .measure import measure_step as measure_step
from .status import StepMemory as StepMemory
