"""Assertions for tests of detectors: residuals below a bound, faults detected in time, quiet on a healthy record.

They fail with an `AssertionError` that names the figure, the bound, and a recording (.rrd, for ``gtmbench view``) of
what failed. In pytest the plugin names the recording after the test; elsewhere it goes into ``gtmbench-artefacts``.
`check_detector` holds a detector of your own to what every detector of the package keeps.
"""

from gtmbench.testing.assertions import assert_detects, assert_quiet, assert_residual
from gtmbench.testing.contract.suite import CONTRACT, check_detector
from gtmbench.testing.shared_flights import fly_once, standard_record

__all__ = [
    "CONTRACT",
    "assert_detects",
    "assert_quiet",
    "assert_residual",
    "check_detector",
    "fly_once",
    "standard_record",
]
