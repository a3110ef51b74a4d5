"""A log's timeline as plain data, beside what was asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gtmbench.report.words.judgement import parameter_units
from gtmbench.report.words.times import stamp_text
from gtmbench.values.channels import unit_of
from gtmbench.verdict.timeline import SensorSpan
from gtmbench.verdict.verdict import LogVerdict


def timeline_table(verdict: LogVerdict, zero_stamp: str = "") -> Mapping[str, Any]:
    """Return the timeline of every sensor; `judged_s` is that of the asked sensor that is judged least."""
    timeline, scope = verdict.timeline, verdict.scope
    return {
        "span_s": timeline.span_s,
        "motion_s": timeline.motion_s,
        "motion_total_s": timeline.motion_total_s,
        "judged_s": verdict.judged_share(*scope.sensors) * timeline.motion_total_s,
        "asked": scope.sensors,
        "limits": {
            "error_deg_s": scope.error_deg_s,
            "error_deg": scope.error_deg,
            "factor": scope.factor,
            "judged_share": scope.judged,
        },
        "told": timeline.told,
        "sensors": {
            name: [_span(name, span, zero_stamp) for span in spans] for name, spans in timeline.sensors.items()
        },
    }


def _span(sensor: str, span: SensorSpan, zero_stamp: str) -> Mapping[str, Any]:
    judged, sizes = span.judgement, span.sizes
    unit = unit_of(sensor)
    kind, parameters = (None, {}) if judged is None else (judged.kind, judged.parameters)
    below, above = (None, None) if sizes is None or sizes.factors is None else sizes.factors
    return {
        "start_s": span.start_s,
        "end_s": span.end_s,
        "start_stamp": stamp_text(zero_stamp, span.start_s, 3),
        "end_stamp": stamp_text(zero_stamp, span.end_s, 3),
        "state": str(span.state),
        "reason": span.reason,
        "suspects": span.suspects,
        "kind": kind,
        "parameters": parameters,
        "parameter_units": parameter_units(kind, parameters, unit) if kind else {},
        "error": None if sizes is None else sizes.error,
        "factor_below": below,
        "factor_above": above,
        "noise": None if sizes is None else sizes.noise,
        "unit": unit,
        "within_s": None if sizes is None else sizes.within_s,
    }
