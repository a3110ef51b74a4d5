"""A monitor that is quick enough to fly with: bank C-early, calibrated on two open-loop flights."""

from functools import cache

import gtmbench as gb
from gtmbench.testing.shared_flights import calibration_records
from tests.helpers.monitors import shared


@cache
def early_monitor():
    bank = gb.load_bank("C-early")
    return shared("rescuing", lambda: gb.calibrate(list(calibration_records()[:2]), bank=bank))
