"""Wrong input of the kinds that people type ends in one line: what was given, what that implies, what to do."""

import json

import pytest
from click.testing import CliRunner

import gtmbench as gb
from gtmbench.cli.app import app
from gtmbench.report.tables.results import _headers
from tests.helpers.commands import COMMANDS

NAMED = "p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg"
ROWS = "\n".join(f"{number},{number % 7},2,3,4,5,6" for number in range(40))
FILES = {
    "bare.csv": ROWS,
    "slow.csv": f"time,{NAMED}\n{ROWS}",
    "wide.csv": f"time_s,p_deg_s\n{ROWS}",
    "flight.csv": f"time_s,{NAMED}\n{ROWS}",
    "book.xlsx": "PK\x03\x04 sheet",
    "one.toml": "[[fault]]\nkind = 'jam'\nchannels = ['p']\nonset_s = 10\n",
    "kind.toml": "[[faults]]\nkind = 'jamm'\nchannels = ['p']\nonset_s = 10\n",
    "channel.toml": "[[faults]]\nkind = 'jam'\nchannels = ['psii']\nonset_s = 10\n",
    "key.toml": "[alarm]\nwidow = 10\n[[faults]]\nkind = 'jam'\nchannels = ['p']\nonset_s = 10\n",
    "seen/a.rrd": "RRF2",
    "seen/b.rrd": "RRF2",
    "craft/plane.xml": "",
    "results.json": "{}",
}


@pytest.fixture
def typed(tmp_path, cli):
    """Return a function that runs a line in a folder of files, and gives the one line that it ends with."""
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="latin-1")
    (tmp_path / "empty").mkdir()
    before = sorted(tmp_path.rglob("*"))

    def run(line):
        code, _, err = cli(*line.split())
        assert code == 2, err
        assert "Traceback" not in err
        assert sorted(tmp_path.rglob("*")) == before
        return err.splitlines()[-1]

    return run


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "monitor bare.csv",
            "no header: columns are called by their numbers, as in --map time=1:s --map p=2:rad/s",
        ),
        ("monitor slow.csv --healthy 0:25", "column 'time' looks like time, but states no unit: --map time=time:s"),
        ("monitor wide.csv", "rows have more cells than the 2 that its first line names"),
        ("monitor book.xlsx", "isn't a readable Excel workbook"),
        ("monitor flight.csv --healthy 0-25", "there is no such log; give a span in seconds, such as 0:30"),
        ("monitor flight.csv --healthy 0-25", "did you mean 0:25?"),
        ("monitor flight.csv --healthy 0:5", "flight.csv has 1 sample a second; at least 2.5 are needed"),
        ("monitor flight.csv --detector C --limit 0", "--limit is 0.0; it must be a finite number"),
        ("monitor flight.csv --detector C --limit nan", "--limit is nan; it must be a finite number"),
        ("monitor flight.csv --detector C --limit infdeg/s", "--limit is inf; it must be a finite number"),
        ("monitor flight.csv --detector C --limit=-2deg/s", "--limit is -2.0; it must be a finite number"),
        ("monitor flight.csv --detector C --limit factor=1", "--limit factor=1 is no fault; give a factor below or"),
        ("monitor flight.csv --detector C --limit 5rad/s", "--limit is '5rad/s'; give 5deg/s, 10deg or factor=0.7"),
        ("monitor flight.csv flight.csv --out o --limit deg", "--limit is 'deg'; give 5deg/s, 10deg or factor=0.7"),
        ("score flight.csv --limit 0deg", "--limit is 0.0; it must be a finite number"),
        ("monitor flght.csv", "flght.csv: no such file; did you mean 'flight.csv'?"),
        ("monitor seen/a.rrd", "is no log but, by its name, a recording, which `gtmbench view` opens"),
        ("monitor one.toml", "a scenario, which `gtmbench run` flies"),
        ("score empty", "empty is a folder; give the logs in it, as empty/*.csv"),
        ("view empty", "empty is a folder without a recording (.rrd); `gtmbench run` writes one"),
        ("view seen", "seen is a folder of 2 recordings; give one: seen/a.rrd or seen/b.rrd"),
        ("verify empty --against seen", "empty is a folder without a recording (.rrd)"),
        ("run --detector flight.csv", "is no detector but, by its name, a log; watch it: gtmbench monitor flight.csv"),
        ("run --detector empty", "empty is a folder; give a bank's .toml or a monitor's .json in it"),
        ("run flight.csv", "is no scenario but, by its name, a log; watch it: gtmbench monitor flight.csv"),
        ("run results.json", "results.json is no scenario: that is a TOML file, and its name ends in .toml"),
        ("run empty", "no scenario 'empty': a folder without a .toml; give a TOML file or one of bias,"),
        ("run .", "a folder that holds channel.toml, key.toml, kind.toml, one.toml; give a TOML file"),
        ("inject jam --fault flight.csv --out b.csv", "is no scenario but, by its name, a log"),
        ("fly --duration -3 --out x.csv", "--duration is -3; it must be a finite number, 0.01 or more"),
        ("fly --noise -5 --out x.csv", "--noise is -5.0; it must be a finite number"),
        ("calibrate --false-alarms-per-hour -1", "--false-alarms-per-hour is -1; it must be"),
        ("aircraft --tas -51.5", "--tas is -51.5; it must be a finite number greater than 0"),
        ("aircraft empty", "is no aircraft's folder: no empty.xml (folder NAME holds a model, NAME.xml"),
        ("aircraft craft", "it holds plane.xml: name the folder like the model"),
        ("fly --altitude 2438 --tas 51.4 --out x.csv", "51.4 m/s is gtm's own speed; speeds are in kt"),
        ("campaign nowhere --report html", "nowhere is no folder; give the one that `gtmbench campaign` has written"),
        ("campaign seen --report html", "seen holds no parts of a run, as `gtmbench campaign` writes"),
        ("view", "Missing argument 'RECORDING.rrd|FOLDER'; gtmbench view --help says what there is"),
    ],
)
def test_what_people_type_ends_in_a_line_that_says_what_to_do(typed, line, said):
    assert said in typed(line)


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("run drfit", "drift"),
        ("run drfit.toml", "drift"),
        ("run one.toml", "faults"),
        ("run kind.toml", "jam"),
        ("run channel.toml", "psi"),
        ("run key.toml", "window"),
        ("campaign whichgyro", "which_gyro"),
        ("check bankC", "bank-C"),
        ("list leave_one_out", "leave-one-out"),
        ("run --detector dissertatio", "dissertation"),
        ("aircraft gmt", "gtm"),
        ("aircraft f_16", "f16"),
        ("fly --excitation multisin --out x.csv", "multisine"),
        ("calibrate --tolerate bais=0.5", "bias"),
        ("calibrate flight.csv --inputs p,q,phii --outputs r --healthy 0:25", "phi"),
    ],
)
def test_every_name_is_answered_with_what_was_likely_meant(typed, line, meant):
    assert typed(line).endswith(f"; did you mean '{meant}'?")


@pytest.mark.parametrize(("line", "meant"), [("campain", "campaign"), ("fly --durations 5", "--duration")])
def test_so_are_commands_and_options(typed, line, meant):
    assert f"'{meant}'" in typed(line)


def test_what_nobody_foresaw_is_no_fault_found(cli, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("gtmbench.bench.flight.trim", broken)
    code, out, err = cli("aircraft")
    assert (code, out) == (2, "")
    assert err.endswith("gtmbench: this shouldn't have happened (ZeroDivisionError: two lines); please report it\n")
    code, out, _ = cli("aircraft", "--json")
    assert json.loads(out)["exit_code"] == code == 2


def test_units_stand_in_the_columns_names():
    assert _headers("hardover", "p") == {"limit": "limit_deg_s", "rate_limit": "rate_limit_deg_s2"}
    assert _headers("random_walk", "nz") == {"gain": "gain_g_sqrt_s"}
    assert _headers("lag", "p") == _headers(None, "p") == {}


def test_commands_without_anything_say_how_they_go():
    """In process, as `--help` is: every command has a usage that begins with its name."""
    for name in COMMANDS:
        shown = CliRunner().invoke(app, [name, "--help"])
        assert shown.exit_code == 0
        assert shown.output.startswith(f"Usage: gtmbench {name}") or f" {name} " in shown.output.splitlines()[0]
    assert gb.__version__ in CliRunner().invoke(app, ["--version"]).output
