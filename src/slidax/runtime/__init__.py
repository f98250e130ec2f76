"""Real-time loop of an exported control law: two processes, a clock, and shared memory; needs no JAX.

Read `sides` first: the law's side computes torques from measurements, the arm's side applies torques and measures.
`processes` runs each side in its own process. `shared_memory` has mailboxes, ring buffers and machine code. `logs`
reads and writes MCAP files, and reads ROS 2 bags. `slidax.export` assembles the loop.
"""

from .shared_memory import Arena as Arena
from .shared_memory import CodePlan as CodePlan
from .shared_memory import MachineCode as MachineCode
from .shared_memory import Mailbox as Mailbox
from .shared_memory import Ring as Ring
from .shared_memory import Slot as Slot
from .shared_memory import create_shared_memory as create_shared_memory
from .shared_memory import map_shared_memory as map_shared_memory
from .sides import KEPT_ROWS as KEPT_ROWS
from .sides import STOP as STOP
from .sides import ArmSide as ArmSide
from .sides import LawSide as LawSide
from .sides import LoopJob as LoopJob
from .sides import MemoryLayout as MemoryLayout
from .sides import SideReport as SideReport
from .sides import Sleeper as Sleeper
from .sides import now as now
