"""Three-dimensional replays of finished runs: live in the browser, or as one HTML file.

`show` and `record` draw the log of a run and simulate nothing. The packages that they need come with
`pip install 'slidax[view]'` and are imported on first use. Register a robot class of your own with
`skeleton_of.register`.
"""

from .show import View as View
from .show import record as record
from .show import require_record as require_record
from .show import require_show as require_show
from .show import show as show
from .skeleton import Skeleton as Skeleton
from .skeleton import skeleton as skeleton
from .skeleton import skeleton_of as skeleton_of
