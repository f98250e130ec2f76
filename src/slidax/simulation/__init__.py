"""Simulation of a plant under a controller, with a `Run` as the result. Only this package integrates over time.

Start with `simulate.py` (one run, a batch, a gradient) and its inputs, `plant.py` and `stepping.py`. `run.py` has the
result. `loop.py` has one sample of the closed loop as pure functions. `engine.py` has the protocol of the engines:
`native_engine.py` compiles the loop to machine code, `xla_engine.py` is the reference, `mujoco_engine.py` lets MuJoCo
move the arm.
"""

from .define import require_fitting as require_fitting
from .engine import EngineName as EngineName
from .outcome import Outcome as Outcome
from .parquet import read_columns as read_columns
from .parquet import require_pyarrow as require_pyarrow
from .plant import FreeBody as FreeBody
from .plant import MujocoPlant as MujocoPlant
from .plant import Plant as Plant
from .plant import Table as Table
from .run import Log as Log
from .run import Run as Run
from .run import RunTiming as RunTiming
from .run import columns_of as columns_of
from .simulate import BANDS as BANDS
from .simulate import Parts as Parts
from .simulate import simulate as simulate
from .simulate import simulate_batch as simulate_batch
from .simulate import value_and_gradient as value_and_gradient
from .stepping import Stepping as Stepping
from .tally import Tally as Tally
