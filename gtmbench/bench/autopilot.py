"""An autopilot: rate damping, attitude, heading and altitude hold, autothrottle; and the trim that it holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from gtmbench.checks import keys, number
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, SENSORS
from gtmbench.values.record import Span

Commands = tuple[float, float, float, float]  # in the order of `COMMANDS`, in their units
_READ = (*GYROS, *ATTITUDE, "tas", "altitude")
_MOST = 1e4  # a gain beyond is none that anybody means


@dataclass(frozen=True, kw_only=True)
class Autopilot:
    """Gains and limits of a simple autopilot, which holds the altitude, speed and heading of the trim.

    With e the held value less the reading, and all values relative to the trim; p, q and r stand for the reading and
    its change, p + lead_s dp/dt, which makes up for sensors that are late::

        elevator = q_to_elevator_s q + theta_to_elevator (theta - theta_c),
        theta_c  = altitude_to_theta_deg_ft e_altitude + altitude_integral_deg_ft_s int e_altitude,
                   within theta_limit_deg;
        aileron  = p_to_aileron_s p + phi_to_aileron (phi - phi_c),
        phi_c    = psi_to_phi e_psi, within phi_limit_deg;
        rudder   = r_to_rudder_s (r - r averaged over washout_s);
        throttle = tas_to_throttle_percent_kt e_tas + tas_integral_percent_kt_s int e_tas.

    An integral stands still while its output is at its limit. A missing reading holds the last one. A gain that is left
    out is 0; without any the commands stay at trim. On another aircraft signs may be others.

    Raises
    ------
    InputError
        If a value is invalid.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import gtmbench as gb
    >>> own = gb.load_aircraft("gtm").autopilot
    >>> replace(own, psi_to_phi=0.0).reads
    ('p', 'q', 'r', 'phi', 'theta', 'tas', 'altitude')
    """

    q_to_elevator_s: float = 0.0
    theta_to_elevator: float = 0.0
    altitude_to_theta_deg_ft: float = 0.0
    altitude_integral_deg_ft_s: float = 0.0
    theta_limit_deg: float = 10.0
    p_to_aileron_s: float = 0.0
    phi_to_aileron: float = 0.0
    psi_to_phi: float = 0.0
    phi_limit_deg: float = 30.0
    r_to_rudder_s: float = 0.0
    washout_s: float = 2.0
    lead_s: float = 0.0
    tas_to_throttle_percent_kt: float = 0.0
    tas_integral_percent_kt_s: float = 0.0

    def __post_init__(self) -> None:
        for each in fields(self):
            is_positive = each.name in ("theta_limit_deg", "phi_limit_deg", "washout_s")
            low = 0.0 if is_positive else -_MOST
            number(f"autopilot.{each.name}", getattr(self, each.name), low, _MOST, above=is_positive)
        number("autopilot.lead_s", self.lead_s, 0.0, 1.0)

    @property
    def reads(self) -> tuple[str, ...]:
        """The channels whose readings move a command."""
        altitude = self.altitude_to_theta_deg_ft or self.altitude_integral_deg_ft_s
        gains = {
            "p": self.p_to_aileron_s,
            "q": self.q_to_elevator_s,
            "r": self.r_to_rudder_s,
            "phi": self.phi_to_aileron,
            "theta": self.theta_to_elevator,
            "psi": self.phi_to_aileron and self.psi_to_phi,
            "tas": self.tas_to_throttle_percent_kt or self.tas_integral_percent_kt_s,
            "altitude": self.theta_to_elevator and altitude,
        }
        return tuple(name for name in _READ if gains[name])

    def engage(
        self, trim: Trim, limits: Mapping[str, Span], sample_period_s: float
    ) -> Callable[[Sequence[float]], Commands]:
        """Return a function from a sample of the sensors, in the order of `SENSORS`, to the commands.

        Parameters
        ----------
        trim : Trim
            The state to hold, to which gains refer.
        limits : mapping
            Limits of the commands, by channel.
        sample_period_s : float
            Ts, in seconds: every call is one sample later.
        """
        trimmed_elevator, trimmed_aileron, trimmed_rudder, trimmed_throttle = (trim.commands[name] for name in COMMANDS)
        least, most = limits["throttle"]
        q_gain, theta_gain = self.q_to_elevator_s, self.theta_to_elevator
        climb_gain, climb_rate = self.altitude_to_theta_deg_ft, self.altitude_integral_deg_ft_s * sample_period_s
        p_gain, phi_gain, psi_gain = self.p_to_aileron_s, self.phi_to_aileron, self.psi_to_phi
        r_gain, forgotten = self.r_to_rudder_s, sample_period_s / self.washout_s
        speed_gain, speed_rate = self.tas_to_throttle_percent_kt, self.tas_integral_percent_kt_s * sample_period_s
        pitch_limit, bank_limit = self.theta_limit_deg, self.phi_limit_deg
        altitude_ft, tas_kt, psi_deg, theta_deg = trim.altitude_ft, trim.tas_kt, trim.yaw_deg, trim.pitch_deg
        climb = speed = turning = 0.0  # the two integrals, in deg and percent, and the average of r
        lead = self.lead_s / sample_period_s
        last = list(_level(trim))

        def command(sample: Sequence[float]) -> Commands:
            nonlocal climb, speed, turning, last
            total = sum(sample)
            if total != total:  # something is missing
                sample = [now if now == now else held for now, held in zip(sample, last, strict=True)]
            before = last
            last = sample  # type: ignore[assignment]
            p, q, r, _, _, phi, theta, psi, _, _, _, tas, altitude = sample
            if lead:
                p, q, r = p + lead * (p - before[0]), q + lead * (q - before[1]), r + lead * (r - before[2])
            above = altitude_ft - altitude
            pitch = climb_gain * above + climb
            if -pitch_limit < pitch < pitch_limit:
                climb += climb_rate * above
            elif pitch > pitch_limit:
                pitch = pitch_limit
            else:
                pitch = -pitch_limit
            bank = psi_gain * ((psi_deg - psi + 180.0) % 360.0 - 180.0)
            if not -bank_limit < bank < bank_limit:
                bank = bank_limit if bank > 0.0 else -bank_limit
            slow = tas_kt - tas
            throttle = trimmed_throttle + speed_gain * slow + speed
            if least < throttle < most:
                speed += speed_rate * slow
            turning += (r - turning) * forgotten
            return (
                trimmed_elevator + q_gain * q + theta_gain * (theta - theta_deg - pitch),
                trimmed_aileron + p_gain * p + phi_gain * (phi - bank),
                trimmed_rudder + r_gain * (r - turning),
                throttle,
            )

        return command


def autopilot_of(table: Mapping[str, Any], own: Autopilot | None = None) -> Autopilot:
    """Return the autopilot of a table ``[autopilot]``: what it says, and else what an aircraft's own says.

    >>> autopilot_of({"psi_to_phi": 1}, Autopilot(p_to_aileron_s=0.2)).p_to_aileron_s
    0.2
    """
    known = keys(dict(table), [each.name for each in fields(Autopilot)], section="autopilot")
    return Autopilot(**((vars(own) if own else {}) | known))


def _level(trim: Trim) -> tuple[float, ...]:
    """Return what perfect sensors read in trim, as far as an autopilot reads it."""
    read = {
        "phi": trim.roll_deg,
        "theta": trim.pitch_deg,
        "psi": trim.yaw_deg,
        "tas": trim.tas_kt,
        "altitude": trim.altitude_ft,
    }
    return tuple(read.get(name, 0.0) for name in SENSORS)


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
