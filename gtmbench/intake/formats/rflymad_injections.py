"""RflyMAD's faults, as the PX4 logs of that data set have them: the topic `rfly_ctrl_lxl` says what is commanded.

Le and others 2024 (RflyMAD: a dataset for multicopter fault detection and health assessment): `id` is the kind of
fault, `mode` how it acts, `controls` its parameters. In force is what the topic says until it says something else.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.injections import GYRO, Injection, injected
from gtmbench.values.clock import FloatArray

_TOPIC = "rfly_ctrl_lxl"
_NONE = 0
_HEALTHY = (_NONE, 123549, 123540)  # ids that are no fault: nothing commanded yet, "without", a waiting time
_IDS = {
    123450: "motor",
    123451: "propeller",
    123452: "accelerometer",
    123453: GYRO,
    123454: "barometer",
    123455: "magnetometer",
    123456: "GPS",
    123457: "payload",
    123458: "payload",
    123459: "payload",
    123541: "battery",
    123542: "battery",
    123543: "battery",
    123544: "wind",
    123545: "wind",
    123546: "wind",
    123547: "wind",
    123548: "wind",
}
_OF_SENSORS = range(123452, 123457)
_MODES = {3.0: "noise", 4.0: "scale factor"}  # of sensors; motors have others
_MOST_CHANGES = 1000  # that are looked at: nobody injects more in a flight
_MOST_CONTROLS = 16


def rflymad_injections(
    topics: Mapping[str, Mapping[str, NDArray[Any]]], clocks: Mapping[str, FloatArray]
) -> list[Injection]:
    """Return the faults that a log of RflyMAD says were injected; nothing of other logs.

    `clocks`: in seconds.
    """
    fields = topics.get(_TOPIC, {})
    if not {"id", "mode"} <= set(fields):
        return []
    ids, times_s = fields["id"].astype(np.int64), clocks[_TOPIC]
    begins = np.flatnonzero(np.diff(ids, prepend=_NONE))[:_MOST_CHANGES].tolist()
    ends_s = [*(float(times_s[row]) for row in begins[1:]), None][: len(begins)]
    return [
        _injection(int(ids[row]), fields, row, float(times_s[row]), end_s)
        for row, end_s in zip(begins, ends_s, strict=True)
        if ids[row] not in _HEALTHY
    ]


def _injection(
    kind: int, fields: Mapping[str, NDArray[Any]], row: int, onset_s: float, end_s: float | None
) -> Injection:
    """Return a fault by the first message that commands it; its parameters in the log's words, for none has a unit."""
    mode = float(fields["mode"][row])
    controls = [fields.get(f"controls[{place}]") for place in range(_MOST_CONTROLS)]
    values = [float(column[row]) for column in controls if column is not None]
    while values and values[-1] == 0.0:
        values.pop()
    sensor = _IDS.get(kind, f"unit {kind}")
    said = _MODES.get(mode, f"mode {mode:g}") if kind in _OF_SENSORS else f"mode {mode:g}"
    text = f"{sensor} {said}: {', '.join(f'{value:g}' for value in values)}"
    return injected(sensor, None, said, (onset_s, end_s), text)
