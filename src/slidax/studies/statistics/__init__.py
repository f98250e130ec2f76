"""Confidence intervals and paired tests."""

from .interval import Interval as Interval
from .paired_differences import PairedDifference as PairedDifference
from .paired_differences import paired_difference as paired_difference
from .paired_shares import PairedShares as PairedShares
from .paired_shares import paired_shares as paired_shares
from .rates import clopper_pearson as clopper_pearson
from .rates import runs_without_failure as runs_without_failure
from .sequence import confidence_sequence as confidence_sequence
from .sequence import log_evidence as log_evidence
