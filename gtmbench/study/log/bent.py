"""What of a monitor's alarms can be believed where a gyro's fault bends the attitude, and the monitor doesn't know.

An estimator turns a gyro's error into all three angles. A monitor that was calibrated for an attitude of its own takes
that for faults of other sensors: so the first fault is believed only, and of an angle none.
"""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.values.channels import ATTITUDE

BENT = "a gyro that drives the attitude may have bent it, and the monitor was calibrated for one of its own"


def are_bent(faults: Sequence[Alarm]) -> list[bool]:
    """Tell of all faults of a flight so far, by their first alarms, which accuse a sensor but may not be believed.

    >>> first, second = (Alarm(number=k, time_s=10.0 + k, onset_s=10.0 + k, source="pq"[k]) for k in (0, 1))
    >>> are_bent([first, second])
    [False, True]
    """
    left = [alarm for alarm in faults if not alarm.has_passed and alarm.test != MISSING]
    first_s = min((alarm.time_s for alarm in left), default=0.0)
    return [
        alarm.accuses and alarm.test != MISSING and (alarm.time_s > first_s or alarm.sensor in ATTITUDE)
        for alarm in faults
    ]
