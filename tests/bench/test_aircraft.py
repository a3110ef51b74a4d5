"""The GTM in JSBSim against the printed trim, and against the same figures put together by other means."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import gtmbench as gb
from gtmbench.bench.engine import engine, set_condition
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.files.shipped import share

CRAFT = load_aircraft("gtm")
SIX = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
MIRRORED = ("CY", "Cl", "Cn")
SPAN_FT, CHORD_FT = 6.8488, 0.9153


def test_trim_is_the_dissertations():
    trim = gb.trim("gtm")
    assert trim.alpha_deg == pytest.approx(3.00, abs=0.05)
    assert trim.pitch_deg == pytest.approx(3.00, abs=0.05)
    assert trim.elevator_deg == pytest.approx(2.70, abs=0.15)
    assert trim.eas_kt == pytest.approx(89.18, abs=0.05)
    assert trim.tas_kt == pytest.approx(100.58, abs=1e-6)
    assert 18.0 < trim.throttle_percent < 25.0
    assert abs(trim.gamma_deg) < 1e-6
    assert abs(trim.roll_deg) < 0.2


def test_trim_error_names_the_acceleration_and_the_limit():
    with pytest.raises(
        gb.TrimError, match=r"400 kt.*forward acceleration \(thrust against drag\).*throttle at its limit"
    ):
        gb.trim("gtm", tas_kt=400.0)
    with pytest.raises(gb.TrimError, match=r"30 kt.*acceleration \(.*throttle at its limit"):
        gb.trim("gtm", tas_kt=30.0)


def test_modes_are_those_of_an_independent_model():
    """Figures: a NumPy implementation of the same equations (flat Earth, own tables, own trim), written apart."""
    independent = {
        "short period": (7.70647, 0.42981),
        "roll": (6.98126, 1.0),
        "dutch roll": (6.78675, 0.12026),
        "phugoid": (0.23003, 0.07651),
        "spiral": (0.04887, 1.0),
    }
    modes = {mode.name: (mode.natural_frequency_rad_s, mode.damping) for mode in gb.modes("gtm")}
    assert modes.keys() == independent.keys()
    for name, expected in independent.items():
        assert modes[name] == pytest.approx(expected, rel=0.005), name


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")  # jsbsim returns one
def test_inertia_matrix_holds_minus_ixz():
    fdm, _ = trimmed_engine(CRAFT)
    inertia = fdm.get_mass_balance().get_J()
    assert inertia[0, 2] == pytest.approx(-0.274)
    np.testing.assert_allclose(np.diag(inertia), [1.221, 4.655, 5.587])


class Tables:
    """The tables of gtm-tables.xml, interpolated by SciPy, and the build-up in Python, from the figures' README."""

    def __init__(self):
        self.tables = {}
        for function in ET.parse(share() / "aircraft/gtm/gtm-tables.xml").getroot().iter("function"):
            if function.find("table") is not None:
                self.tables[function.get("name").removeprefix("aero/")] = self._table(function.find("table"))

    @staticmethod
    def _table(table):
        layers, points = [], []
        for data in table.findall("tableData"):
            lines = [np.array(line.split(), dtype=float) for line in data.text.strip().splitlines()]
            columns, rows = lines[0], np.array([line[0] for line in lines[1:]])
            layers.append(np.array([line[1:] for line in lines[1:]]))
            points.append(float(data.get("breakPoint", "nan")))
        axes = [rows, columns] if len(layers) == 1 else [rows, columns, np.array(points)]
        values = layers[0] if len(layers) == 1 else np.stack(layers, axis=-1)
        return axes, RegularGridInterpolator(axes, values)

    def __call__(self, name, *at):
        if name not in self.tables:
            return 0.0  # the elevator, say, has no side force
        axes, interpolate = self.tables[name]
        return interpolate([np.clip(x, axis[0], axis[-1]) for x, axis in zip(at, axes, strict=True)])[0]


def split(p, q, r, alpha, beta):
    """The hybrid Kalviste split, after shared figures: Omega, and the oscillatory remainder."""
    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    result = (0.0, p, q, r)
    if ca * cb != 0 and p != 0:
        omega = p / (ca * cb)
        left = r - omega * sa * cb
        if abs(left) <= abs(r) and left * r >= 0:
            result = (omega, 0.0, q - omega * sb, left)
    if sa * cb != 0 and r != 0:
        omega = r / (sa * cb)
        left = p - omega * ca * cb
        if abs(left) <= abs(p) and left * p >= 0:
            result = (omega, left, q - omega * sb, 0.0)
    return result


def build_up(tables, at):
    alpha, beta, da, dr = at["alpha"], at["beta"], at["aileron"], at["rudder"]
    speed = at["tas"] * 1852 / 3600 / 0.3048
    rates = np.deg2rad([at["p"], at["q"], at["r"]])
    omega, p, q, r = split(*rates, np.deg2rad(alpha), np.deg2rad(beta))
    b2v, c2v = SPAN_FT / (2 * speed), CHORD_FT / (2 * speed)
    total = {}
    for c in SIX:
        mirror = -1 if c in MIRRORED else 1
        side = -1 if dr > 0 else 1
        total[c] = (
            tables(f"bare/{c}", alpha, beta)
            + tables(f"elevator/{c}", alpha, beta, at["elevator"])
            + tables(f"right-aileron/{c}", alpha, beta, da)
            + mirror * tables(f"right-aileron/{c}", alpha, -beta, -da)
            + (mirror if side < 0 else 1) * tables(f"rudder/{c}", alpha, side * beta, side * dr)
            + tables(f"rotary/{c}", alpha, beta, omega * b2v)
            + tables(f"forced-p/{c}", alpha, p * b2v)
            + tables(f"forced-q/{c}", alpha, q * c2v)
            + tables(f"forced-r/{c}", alpha, r * b2v)
        )
    return total


def test_coefficients_are_the_tables_put_together_in_python():
    random = np.random.default_rng(20261120)
    tables = Tables()
    fdm = engine(CRAFT)
    coefficients, expected = [], []
    spans = {"alpha": (-5, 30), "beta": (-20, 20), "tas": (70, 130), "p": (-40, 40), "q": (-25, 25), "r": (-40, 40),
             "elevator": (-30, 20), "aileron": (-20, 20), "rudder": (-30, 30)}  # fmt: skip
    for _ in range(150):
        at = {name: random.uniform(*span) for name, span in spans.items()}
        set_condition(fdm, CRAFT, {**at, "altitude": 8000, "psi": 0, "phi": 0, "theta": at["alpha"], "throttle": 0})
        assert fdm["aero/alpha-deg"] == pytest.approx(at["alpha"], abs=1e-9)
        assert fdm["aero/beta-deg"] == pytest.approx(at["beta"], abs=1e-9)
        coefficients.append([fdm[f"aero/{c}"] for c in SIX])
        expected.append(list(build_up(tables, at).values()))
    scale = np.ptp(expected, axis=0)
    assert np.abs((np.array(coefficients) - np.array(expected)) / scale).max() < 1e-9


def test_servos_stand_where_commanded_after_run_ic_and_lag_in_flight():
    fdm = engine(CRAFT)
    trim = gb.trim("gtm")
    at = {"alpha": 3.0, "beta": 0.0, "tas": 100.58, "altitude": 8000, "psi": 0, "phi": 0, "theta": 3.0, **trim.commands}
    for elevator in (-10.0, 5.0):
        set_condition(fdm, CRAFT, {**at, "elevator": elevator})
        assert fdm["fcs/elevator-pos-deg"] == pytest.approx(elevator, abs=1e-12)
    fdm["fcs/elevator-cmd-deg"] = 6.0
    steps = [fdm["fcs/elevator-pos-deg"] for _ in range(20) if fdm.run()]
    # a first-order lag of 5 Hz, sampled exactly
    np.testing.assert_allclose(steps, 6.0 - np.exp(-2 * np.pi * 5.0 * 0.01 * np.arange(1, 21)), atol=1e-9)
    fdm["fcs/elevator-cmd-deg"] = -30.0
    fdm.run()
    assert steps[-1] - fdm["fcs/elevator-pos-deg"] == pytest.approx(3.0)  # 300 deg/s


def test_unknown_aircraft_is_refused_with_the_known_ones():
    with pytest.raises(gb.InputError, match=r"no aircraft 'f17'; there are gtm and JSBSim's own"):
        gb.trim("f17")


@pytest.fixture
def mine(copied_gtm):
    return copied_gtm("mine")


def test_an_aircraft_is_a_folder_anywhere(mine, monkeypatch):
    expected = gb.trim("gtm")
    assert gb.trim(str(mine)) == gb.trim(mine) == expected
    monkeypatch.chdir(mine.parent)
    assert gb.trim("mine") == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [("rudder = [-30.0, 30.0]\n", r"\[limits\] lacks rudder"), ("alpha = [-5.0, 85.0]\n", r"\[envelope\] lacks alpha"),
     (", throttle = 20.0", r"\[trim.guess\] lacks throttle"), ("tas_kt = 100.58\n", r"\[trim\] lacks tas_kt")],
)  # fmt: skip
def test_an_incomplete_aircraft_is_refused_by_what_it_lacks(mine, line, message):
    path = mine / "aircraft.toml"
    assert line in path.read_text()
    path.write_text(path.read_text().replace(line, ""))
    with pytest.raises(gb.InputError, match=message):
        gb.trim(mine)


def test_a_broken_model_is_an_error_of_ours(mine):
    model = mine / "mine.xml"
    whole = model.read_text()
    model.write_text(whole.replace("fcs/elevator-cmd-deg", "fcs/elevator-order-deg"))
    with pytest.raises(gb.GtmbenchError, match=r"no property 'fcs/elevator-cmd-deg', which channel 'elevator' needs"):
        gb.trim(mine)
    model.write_text(whole[: len(whole) // 2])
    with pytest.raises(gb.GtmbenchError, match="isn't whole XML"):
        gb.trim(mine)


def test_its_readme_tells_a_jsbsim_user_how_to_fly_it(capfd):
    (code,) = re.findall(r"```python\n(.*?)```", (share() / "aircraft/gtm/README.md").read_text(), flags=re.DOTALL)
    exec(code.replace("path/that/holds/aircraft", str(share())), {})
    altitude_ft, alpha_deg, _ = (float(word) for word in capfd.readouterr().out.split()[-3:])
    assert altitude_ft == pytest.approx(8000.0, abs=50.0)
    assert alpha_deg == pytest.approx(2.97, abs=0.05)
