"""In which unit accelerometers read that state none: most of the time they feel one g."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.names import triples
from gtmbench.values.channels import ACCELEROMETERS, G_M_S2, GYROS

Known = Mapping[str, tuple[RawSeries, Meaning]]
_UNITS = {"g": 1.0, "mg": 1e3, "m/s2": G_M_S2, "cm/s2": 100 * G_M_S2} | {
    f"{1 / counts:.12g} g": float(counts) for counts in (2**power for power in range(8, 16))
}
_WITHIN, _OTHERS = 0.03, 0.1  # of a unit, as a logarithm: which it is, and how far all others have to be
_ALONG = 0.8  # of what is felt: the way that z points


def forces_by_gravity(raw: RawLog, known: Known) -> dict[str, tuple[RawSeries, Meaning]]:
    """Return the accelerometers beside the gyros, in the unit and on the axes that gravity shows; none elsewhere.

    They are mounted as the gyros of the same sensor are, and gravity has to agree with that. Milligrams can't be told
    from 1,024 counts a g: neither is taken.

    `raw`: its clocks known. `known`: channels that are settled: a column and what it is.
    """
    clocks = {known[name][0].clock for name in GYROS if name in known}
    if not set(GYROS) <= set(known) or set(ACCELEROMETERS) & set(known) or len(clocks) > 1:
        return {}
    (clock,) = clocks
    settled = {id(series) for series, _ in known.values()}
    beside = [each for each in triples(raw.series) if each.kind == "acceleration" and each.clock == clock]
    own = [each for each in beside if not each.stated and not each.meanings and not settled & set(map(id, each.series))]
    if len(own) != 1:
        return {}
    felt = np.column_stack([series.values() for series in own[0].series])
    felt = felt[np.isfinite(felt).all(axis=1)]
    usual = float(np.median(np.linalg.norm(felt, axis=1))) if len(felt) else 0.0
    off = {name: abs(math.log(usual / size)) for name, size in _UNITS.items()} if usual > 0.0 else {}
    near = sorted(off, key=off.__getitem__)[:2]
    signs = [known[name][1].sign for name in GYROS]
    if not off or off[near[0]] > _WITHIN or off[near[1]] < _OTHERS:
        return {}
    if float(np.mean(felt[:, 2])) * signs[2] > -_ALONG * usual:
        return {}
    signs[2] = -signs[2]  # a load factor points up
    why = f"gravity: it feels {usual:.4g} most of the time"
    return {
        channel: (series, Meaning(channel=channel, unit=near[0], sign=sign, guessed=why))
        for channel, series, sign in zip(ACCELEROMETERS, own[0].series, signs, strict=True)
    }
