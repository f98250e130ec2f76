"""The one place where time passes: a plant under a controller becomes a Run."""

from .columns import columns_of as columns_of
from .define import require_fitting as require_fitting
from .engine import EngineName as EngineName
from .free_body import FreeBody as FreeBody
from .mujoco_plant import MujocoPlant as MujocoPlant
from .mujoco_plant import Table as Table
from .outcome import Outcome as Outcome
from .parquet import read_columns as read_columns
from .parquet import require_pyarrow as require_pyarrow
from .plant import Plant as Plant
from .run import Log as Log
from .run import Run as Run
from .run import Timing as Timing
from .simulate import BANDS as BANDS
from .simulate import simulate as simulate
from .simulate_batch import Parts as Parts
from .simulate_batch import simulate_batch as simulate_batch
from .stepping import Stepping as Stepping
from .tally import Tally as Tally
from .value_and_gradient import value_and_gradient as value_and_gradient
