"""A transport aircraft's manoeuvres as a flight recorder has them: JSBSim's own A320, imperfect sensors."""

import os
from functools import cache

import numpy as np
from scipy.signal import butter, lfilter

import gtmbench as gb

os.environ["JSBSIM_DEBUG"] = "0"  # no banner
RATE_HZ = 100  # of the flight; records have a whole fraction of it
MANOEUVRES = {  # surface, start (s), unit of time (s), size of the command, signs unit by unit
    "pitch": [("elevator", 3.0, 1.0, 0.12, "+++--+-")],
    "roll": [("aileron", 3.0, 2.0, 0.15, "+--+")],
    "yaw": [("rudder", 3.0, 2.0, 0.25, "+-")],
    "late": [("aileron", 9.0, 1.5, -0.1, "+--+"), ("rudder", 18.0, 1.5, 0.15, "-+"), ("elevator", 5.0, 0.7, 0.1, "-+")],
    "all": [
        ("elevator", 2.0, 1.0, 0.1, "+++--+-"),
        ("aileron", 11.0, 1.5, 0.12, "+--+"),
        ("rudder", 20.0, 1.5, 0.2, "+-"),
    ],
    "still": [],
}
MINUTE = [*MANOEUVRES["all"], *((surface, 30.0 + start_s, *rest) for surface, start_s, *rest in MANOEUVRES["late"])]
# property, factor to the channel's unit, noise, step of quantisation, bias, gain
SENSORS = {
    "p": ("velocities/p-rad_sec", 57.29578, 0.06, 0.02, 0.15, 1.01),
    "q": ("velocities/q-rad_sec", 57.29578, 0.04, 0.02, -0.1, 0.99),
    "r": ("velocities/r-rad_sec", 57.29578, 0.03, 0.02, 0.08, 1.008),
    "phi": ("attitude/phi-rad", 57.29578, 0.01, 0.02, 0.3, 1.0),
    "theta": ("attitude/theta-rad", 57.29578, 0.01, 0.02, 0.2, 1.0),
    "psi": ("attitude/psi-rad", 57.29578, 0.02, 0.02, 1.0, 1.0),
    "beta": ("aero/beta-rad", 57.29578, 0.06, 0.02, -0.6, 1.12),
    "ny": ("accelerations/Ny", 1.0, 0.002, 0.0005, -0.004, 1.0),
}
SHAKEN = ("p", "q", "r", "ny")  # by the structure, in 4 to 8 Hz


@cache
def flown(manoeuvre, duration_s=30):
    """Return the truth at 100 Hz, one column a sensor."""
    import jsbsim

    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / RATE_HZ)
    fdm.load_model("A320")
    fdm.disable_output()
    for name, value in {"h-sl-ft": 15000.0, "vc-kts": 280.0, "gamma-deg": 0.0, "psi-true-deg": 40.0}.items():
        fdm[f"ic/{name}"] = value
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    fdm.do_trim(1)
    trim = {surface: fdm[f"fcs/{surface}-cmd-norm"] for surface in ("elevator", "aileron", "rudder")}
    rows, pushes = [], MINUTE if manoeuvre == "minute" else MANOEUVRES[manoeuvre]
    for k in range(duration_s * RATE_HZ + 1):
        for surface, value in trim.items():
            pushed = sum(_push(k / RATE_HZ, *one[1:]) for one in pushes if one[0] == surface)
            fdm[f"fcs/{surface}-cmd-norm"] = value + pushed
        fdm.run()
        rows.append([fdm[name] * factor for name, factor, *_ in SENSORS.values()])
    truth = np.array(rows)
    psi = list(SENSORS).index("psi")
    truth[:, psi] = np.unwrap(truth[:, psi], period=360.0)
    return truth


def _push(time_s, start_s, unit_s, size, signs):
    at = int((time_s - start_s) // unit_s)
    return size * {"+": 1.0, "-": -1.0}[signs[at]] if 0 <= at < len(signs) else 0.0


def airliner(manoeuvre, seed=1, *, rate_hz=25, duration_s=30):
    """Return a manoeuvre as its sensors tell it: lags, vibration, gains, biases, noise, quantisation."""
    random = np.random.default_rng(seed)
    columns = []
    for (name, (_, _, noise, step, bias, gain)), true in zip(
        SENSORS.items(), flown(manoeuvre, duration_s).T, strict=True
    ):
        kept = np.exp(-1.0 / RATE_HZ / (0.04 if name in ("phi", "theta", "psi") else 0.02))
        read = gain * lfilter([1.0 - kept], [1.0, -kept], true, zi=[kept * true[0]])[0] + bias
        if name in SHAKEN:
            shaken = lfilter(*butter(2, [4.0, 8.0], "band", fs=RATE_HZ), random.standard_normal(len(read) + 500))[500:]
            read = read + noise * shaken / shaken.std()
        read = read[:: RATE_HZ // rate_hz]
        read = read + noise * random.standard_normal(len(read))
        columns.append(np.round(read / step) * step)
    return gb.Record(np.column_stack(columns), channels=list(SENSORS), sample_period_s=1.0 / rate_hz)
