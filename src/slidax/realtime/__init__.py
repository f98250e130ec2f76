"""A loop in real time: two processes, a clock, and memory that they share. Knows nothing of laws, and needs no JAX."""

from .arena import Arena as Arena
from .arena import Coded as Coded
from .arena import Plan as Plan
from .arena import Slot as Slot
from .arm import Arm as Arm
from .board import Mailbox as Mailbox
from .board import Ring as Ring
from .board import anonymous as anonymous
from .board import mapped as mapped
from .clock import Sleeper as Sleeper
from .clock import now as now
from .job import KEPT_ROWS as KEPT_ROWS
from .job import STOP as STOP
from .job import Job as Job
from .job import Places as Places
from .job import Report as Report
from .law import Law as Law
