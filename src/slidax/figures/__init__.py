"""Figures of finished runs, made to be printed: one function per figure, each returns a matplotlib Figure.

Figures draw what they are given and compute nothing. They use no pyplot and leave no state: save them with
`figure.savefig("error.pdf")`, or with `save` as a small SVG.
"""

from .aims_front import aims_front as aims_front
from .bode import bode as bode
from .bode import nyquist as nyquist
from .bounded_error import bounded_error as bounded_error
from .compared_errors import compared_errors as compared_errors
from .compared_tip_paths import compared_tip_paths as compared_tip_paths
from .compared_torques import compared_torques as compared_torques
from .compared_velocity_errors import compared_velocity_errors as compared_velocity_errors
from .error_sizes import error_sizes as error_sizes
from .histograms import histograms as histograms
from .identified_torques import identified_torques as identified_torques
from .intervals import intervals as intervals
from .latencies import latencies as latencies
from .league_table import benchmark_table as benchmark_table
from .margin_over import margin_over as margin_over
from .metric_bars import metric_bars as metric_bars
from .parameter_map import parameter_map as parameter_map
from .performance import performance as performance
from .search_history import search_history as search_history
from .style import STYLE as STYLE
from .svg import inline as inline
from .svg import save as save
from .svg import to_svg as to_svg
from .tip_path import tip_path as tip_path
from .torque import torque as torque
from .tracking_error import tracking_error as tracking_error
from .variance_shares import variance_shares as variance_shares
from .velocity_error import velocity_error as velocity_error
