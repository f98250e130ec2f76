"""A finished run in three dimensions: in the browser while you look, or as a file that needs no Python.

`show` and `record` draw what the log of a run says and compute nothing of their own. The packages that draw come with
`pip install 'slidax[view]'`, for films with `'slidax[film]'`, and are imported when they are first needed.
"""

from .record import record as record
from .record import require_record as require_record
from .show import View as View
from .show import require_show as require_show
from .show import show as show
from .skeleton import Skeleton as Skeleton
from .skeleton import skeleton as skeleton
from .skeleton import skeleton_of as skeleton_of
