"""The smallest fault that a detector sees: of each kind and channel, by bisection on every flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.study.scores.intervals import Estimate, Share, quantile, share

if TYPE_CHECKING:
    import pandas as pd

SHARE = 0.9  # of the searches, one a flight and onset


@dataclass(frozen=True, kw_only=True)
class Smallest:
    """From which severity on a kind of fault of a channel is detected in 90 % of the searches.

    Attributes
    ----------
    fault, channel, parameter : str
    share_of : str or None
        Of what severities are shares: "rms", "peak", "slew"; None: they are figures in the parameter's unit.
    mildest, severest : float
        What was searched between.
    found : Share
        Of the searches, those that found any; a detector that alarms without the fault isn't asked.
    severity : Estimate
        Infinite: beyond the severest; at the mildest: there, or below. So its bounds, too.
    """

    fault: str
    channel: str
    parameter: str
    share_of: str | None
    mildest: float
    severest: float
    found: Share
    severity: Estimate

    @property
    def is_beyond(self) -> bool:
        """Whether even the severest isn't detected so often."""
        return not np.isfinite(self.severity.value)


def smallest(searches: pd.DataFrame) -> tuple[Smallest, ...]:
    """Return them, a kind and channel each, in the order in which they come.

    Parameters
    ----------
    searches : DataFrame
        A detector's rows of searches, with a column `flight`, those that couldn't be asked left out.
    """
    keys = ["fault", "channel", "severity_name", "severity_of", "mildest", "severest"]
    return tuple(_smallest(own) for _, own in searches.groupby(keys, sort=False, dropna=False))


def _smallest(rows: pd.DataFrame) -> Smallest:
    first = rows.iloc[0]
    mildest, severest = float(first["mildest"]), float(first["severest"])
    turn = 1.0 if severest > mildest else -1.0  # a limit is severer the smaller it is
    flights, found = rows["flight"].to_numpy(), rows["smallest"].notna().to_numpy()
    severities = np.where(found, turn * rows["smallest"].to_numpy(dtype=float, na_value=np.nan), np.inf)
    turned = quantile(severities, SHARE, flights)

    def back(value: float | None) -> float | None:
        return None if value is None else turn * value if np.isfinite(value) else np.inf

    value = back(turned.value)
    assert value is not None
    return Smallest(
        fault=str(first["fault"]),
        channel=str(first["channel"]),
        parameter=str(first["severity_name"]),
        share_of=str(first["severity_of"]) if isinstance(first["severity_of"], str) else None,
        mildest=mildest,
        severest=severest,
        found=share(found, flights),
        severity=Estimate(value=value, low=back(turned.low), high=back(turned.high)),
    )
