"""Figures of finished runs, made to be printed: one function per figure, each returns a matplotlib Figure.

Figures draw their arguments and compute nothing. They use no pyplot and leave no state: save them with
`figure.savefig("error.pdf")`, or with `save` as a small SVG. Start with `run.py` for figures of one run; `style.py` has
the common style.
"""

from .chatter import compared_torques as compared_torques
from .compared import compared_errors as compared_errors
from .compared import compared_tip_paths as compared_tip_paths
from .compared import compared_velocity_errors as compared_velocity_errors
from .compared import metric_bars as metric_bars
from .loops import bode as bode
from .loops import bounded_error as bounded_error
from .loops import latencies as latencies
from .loops import nyquist as nyquist
from .overlay import envelope_share as envelope_share
from .run import error_sizes as error_sizes
from .run import identified_torques as identified_torques
from .run import performance as performance
from .run import tip_path as tip_path
from .run import torque as torque
from .run import tracking_error as tracking_error
from .run import velocity_error as velocity_error
from .studies import benchmark_table as benchmark_table
from .studies import histograms as histograms
from .studies import intervals as intervals
from .studies import margin_over as margin_over
from .studies import parameter_map as parameter_map
from .studies import pareto_front as pareto_front
from .studies import search_history as search_history
from .studies import variance_shares as variance_shares
from .style import STYLE as STYLE
from .style import inline_svg as inline_svg
from .style import save as save
from .style import to_svg as to_svg
