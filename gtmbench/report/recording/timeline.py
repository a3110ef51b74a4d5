"""The recording's timeline: seconds of the flight, to the nanosecond."""

from __future__ import annotations

import numpy as np
import rerun as rr

from gtmbench.record import FloatArray

TIMELINE = "time"


def times(time_s: FloatArray) -> rr.TimeColumn:
    """Return times as rerun takes them: whole nanoseconds, for it cuts float seconds off."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def set_time(recording: rr.RecordingStream, time_s: float) -> None:
    """Set the time of what is logged next."""
    recording.set_time(TIMELINE, duration=np.timedelta64(round(time_s * 1e9), "ns"))
