"""Three-dimensional replays of finished runs: live in the browser, or as one HTML file.

`show` and `record` draw the log of a run and compute nothing of their own. The packages that they need come with
`pip install 'slidax[view]'` and are imported on first use. `skeleton_of.register` teaches the drawing a robot class of
your own.
"""

from .show import View as View
from .show import record as record
from .show import require_record as require_record
from .show import require_show as require_show
from .show import show as show
from .skeleton import Skeleton as Skeleton
from .skeleton import skeleton as skeleton
from .skeleton import skeleton_of as skeleton_of
