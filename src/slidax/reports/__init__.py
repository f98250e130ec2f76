"""HTML pages with their figures beside them as SVG, and files of a run."""

from .certificate_report import write_certificate_report as write_certificate_report
from .comparison import write_comparison as write_comparison
from .identification_report import write_identification_report as write_identification_report
from .linear_report import write_linear_report as write_linear_report
from .machine import machine as machine
from .machine import versions as versions
from .numbers import significant as significant
from .numbers import typeset as typeset
from .page import render as render
from .page import write_page as write_page
from .parameters import write_scenario as write_scenario
from .picture import Picture as Picture
from .picture import picture as picture
from .rival import Rival as Rival
from .run_report import write_run_report as write_run_report
from .standings import Row as Row
from .standings import results as results
from .standings import standings as standings
from .study_report import write_study_report as write_study_report
from .tip_paths import tip_paths as tip_paths
