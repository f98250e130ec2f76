"""Output of finished runs: figures, HTML pages, files, and three-dimensional replays.

Results are data; this subpackage draws them and simulates nothing, except `Rival.simulated` for comparisons.

- `figures/`: matplotlib figures, one function each.
- `page.py`, `pages.py`, `comparison.py`: self-contained HTML pages; their figures are also SVG files.
- `files.py`: logs as Parquet, scenarios as YAML.
- `replay/`: three-dimensional replays, live in the browser or as one HTML file.
"""

from .comparison import MetricRow as MetricRow
from .comparison import Rival as Rival
from .comparison import results as results
from .comparison import standings as standings
from .comparison import write_comparison as write_comparison
from .files import write_scenario as write_scenario
from .page import Picture as Picture
from .page import machine as machine
from .page import picture as picture
from .page import render as render
from .page import significant as significant
from .page import typeset as typeset
from .page import versions as versions
from .page import write_page as write_page
from .pages import tip_paths as tip_paths
from .pages import write_certificate_report as write_certificate_report
from .pages import write_identification_report as write_identification_report
from .pages import write_linear_report as write_linear_report
from .pages import write_run_report as write_run_report
from .pages import write_study_report as write_study_report
