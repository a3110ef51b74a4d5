"""What trim finds: the condition, attitude and commands of steady level flight, from which every flight starts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Trim:
    """Steady level flight: condition, attitude and commands. Angles in degrees, units in the names.

    Examples
    --------
    >>> import gtmbench as gb
    >>> level = gb.trim("gtm")
    >>> round(level.tas_kt, 2), round(level.alpha_deg, 1), round(level.commands["throttle"])
    (100.58, 3.0, 21)
    """

    altitude_ft: float
    eas_kt: float
    tas_kt: float
    alpha_deg: float
    beta_deg: float
    gamma_deg: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    ground_track_deg: float
    elevator_deg: float
    aileron_deg: float
    rudder_deg: float
    throttle_percent: float

    @property
    def commands(self) -> dict[str, float]:
        """The trimmed commands by channel, in the channel's unit."""
        return {
            "elevator": self.elevator_deg,
            "aileron": self.aileron_deg,
            "rudder": self.rudder_deg,
            "throttle": self.throttle_percent,
        }
