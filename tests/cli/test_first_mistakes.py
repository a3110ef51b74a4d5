"""The mistakes that a newcomer makes: one line, exit code 2; what was given, what that implies, what to type."""

import gzip
import io
import json
import re
import shlex
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers.night import by_day

HEAD = "time_s,p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg"
BARE = "time_s,gyro_x,gyro_y,gyro_z,roll,pitch,yaw"
P, RATES, MOTION = [1], [1, 2, 3], [1, 2, 3, 4, 5, 6]


@cache
def flight():
    """Return 80 s at 25 Hz, a row a sample: time, and gyros and attitude that tell of one motion."""
    time_s, noise = np.arange(2000) / 25.0, np.random.default_rng(7).standard_normal((2000, 6))
    waves = [[(20.0, 0.4), (10.0, 1.3)], [(8.0, 0.5), (4.0, 1.1)], [(25.0, 0.3), (6.0, 0.9)]]
    angles = np.radians([sum(size * np.sin(rate * time_s) for size, rate in wave) for wave in waves])
    phi_dot, theta_dot, psi_dot = np.radians(
        [sum(size * rate * np.cos(rate * time_s) for size, rate in wave) for wave in waves]
    )
    phi, theta, _ = angles
    p = phi_dot - psi_dot * np.sin(theta)
    q = theta_dot * np.cos(phi) + psi_dot * np.sin(phi) * np.cos(theta)
    r = psi_dot * np.cos(phi) * np.cos(theta) - theta_dot * np.sin(phi)
    values = np.degrees(np.column_stack([p, q, r, *angles])) + noise * [0.1, 0.1, 0.1, 0.02, 0.02, 0.02]
    return np.column_stack([time_s, values])


def text(rows=None, head=HEAD, *, separator=",", decimal="."):
    rows = flight() if rows is None else rows
    lines = (separator.join(f"{value:.10g}".replace(".", decimal) for value in row) for row in rows)
    return "\n".join([head.replace(",", separator), *lines, ""])


FAULT = "[[faults]]\nkind = 'jam'\nchannels = ['p']\nonset_s = 10\n"


def scaled(columns, factor, head=HEAD):
    rows = flight().copy()
    rows[:, columns] *= factor
    return text(rows, head)


def put(columns, values, head=HEAD):
    rows = flight().copy()
    rows[:, columns] = values
    return text(rows, head)


def packed(name, content="x"):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def with_words():
    header, *lines = text().splitlines()
    rows = [line.split(",") for line in lines]
    return "\n".join(
        [header, *(",".join([row[0], "OVF" if k % 3 else row[1], *row[2:]]) for k, row in enumerate(rows))]
    )


FILES = {
    "flight.csv": text,
    "flights/day1.csv": text,
    "flights/day2.csv": text,
    "notes/readme.md": lambda: "x",
    "bare.csv": lambda: text(head=BARE),
    "small.csv": lambda: text(flight()[:, :4] * [1, *3 * [np.pi / 180.0]], head=BARE.removesuffix(",roll,pitch,yaw")),
    "letters.csv": lambda: text(head="time_s,a,b,c,d,e,f"),
    "slow.csv": lambda: text(flight()[::25]),
    "shuffled.csv": lambda: text(np.random.default_rng(1).permutation(flight())),
    "seconds.csv": lambda: put(0, np.floor(flight()[:, 0])),
    "ms.csv": lambda: scaled(0, 1e3),
    "us.csv": lambda: scaled(0, 1e6),
    "stamp.csv": lambda: scaled(0, 1e6, head=HEAD.replace("time_s", "timestamp")),
    "two_times.csv": lambda: text(
        flight()[:, [0, *range(7)]] * [1, 2, *6 * [1]], head="t_s,timestamp_s," + HEAD.removeprefix("time_s,")
    ),
    "words.csv": with_words,
    "comma.csv": lambda: text(decimal=","),
    "german.csv": lambda: text(separator=";", decimal=","),
    "tabs.csv": lambda: text(separator="\t"),
    "bom.csv": lambda: "\ufeff" + text(),
    "utf16.csv": lambda: text().encode("utf-16"),
    "empty.csv": lambda: "",
    "header.csv": lambda: HEAD + "\n",
    "one_row.csv": lambda: text(flight()[:1]),
    "short.csv": lambda: text(flight()[:12]),
    "two_seconds.csv": lambda: text(flight()[:50]),
    "headless.csv": lambda: text().partition("\n")[2],
    "wide.csv": lambda: text(head="time_s,p_deg_s,q_deg_s"),
    "joined.csv": lambda: text(flight()[:1000]) + text(flight()[1000:]),
    "book.csv": lambda: packed("[Content_Types].xml"),
    "book.xlsx": lambda: packed("xl/workbook.xml"),
    "old_book.csv": lambda: b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600),
    "zipped.csv": lambda: packed("flight.csv"),
    "flight.csv.gz": lambda: gzip.compress(text().encode()),
    "binary.csv": lambda: bytes(range(256)),
    "json.csv": lambda: json.dumps({"time_s": [0.0, 0.1], "p": [1.0, 2.0]}),
    "page.csv": lambda: "<!DOCTYPE html>\n<html>not found, try again</html>\n",
    "flight.ulg": text,
    "flight.mat": lambda: b"MATLAB 5.0 MAT-file" + bytes(200),
    "nan.csv": lambda: put(P, np.nan),
    "dead.csv": lambda: put(P, 0.25),
    "radians.csv": lambda: scaled(MOTION, np.pi / 180.0),
    "gyros_in_radians.csv": lambda: scaled(RATES, np.pi / 180.0),
    "degrees.csv": lambda: text(head=HEAD.replace("deg", "rad")),
    "swapped.csv": lambda: text(flight()[:, [0, 2, 1, 3, 4, 5, 6]]),
    "one.toml": lambda: FAULT,
    "kind.toml": lambda: FAULT.replace("jam", "jamm"),
    "channel.toml": lambda: FAULT.replace("p", "psii"),
    "key.toml": lambda: "[alarm]\nwidow = 10\n" + FAULT,
    "group.toml": lambda: FAULT.replace("faults", "fault"),
    "seen/a.rrd": lambda: "RRF2",
    "seen/b.rrd": lambda: "RRF2",
    "craft/plane.xml": lambda: "x",
    "monitor.json": lambda: Path(gb.__file__).with_name("baselines").joinpath("bank-C.json").read_bytes(),
    "results.json": lambda: "{}",
    "there.png": lambda: "x",
}
NO_CHANNEL = "is no channel; before the = stands one, such as p, and behind it the log's column: --map p=COLUMN:UNIT"
SPAN = "and there is no such log; give a span in seconds, such as 0:30, or another log"
READ = "read are CSV, ... and folders of tables"

NEARLY = [
    ("run group.toml", "faults"),
    ("run kind.toml", "jam"),
    ("run channel.toml", "psi"),
    ("run key.toml", "window"),
    ("campaign whichgyro", "which_gyro"),
    ("check bankC", "bank-C"),
    ("calibrate --tolerate bais=0.5", "bias"),
]

# what is typed, the files that are there being those named, and what is said: "..." stands for whatever is between
MISTAKES = [
    # figures, folders, and files of another kind
    ("monitor flight.csv --detector C --limit 0", "--limit is 0.0; it must be a finite number..."),
    ("monitor flight.csv --detector C --limit=-2deg/s", "--limit is -2.0; it must be a finite number..."),
    ("monitor flight.csv --detector C --limit factor=1", "--limit factor=1 is no fault; give a factor below or..."),
    ("monitor flight.csv --detector C --limit 5rad/s", "--limit is '5rad/s'; give 5deg/s, 10deg or factor=0.7..."),
    ("monitor seen/a.rrd", "... is no log but, by its name, a recording, which `gtmbench view` opens..."),
    ("monitor one.toml", "... a scenario, which `gtmbench run` flies..."),
    ("view notes # notes/readme.md", "notes is a folder without a recording (.rrd); `gtmbench run` writes one"),
    ("view seen # seen/a.rrd seen/b.rrd", "seen is a folder of 2 recordings; give one: seen/a.rrd or seen/b.rrd"),
    ("verify notes --against seen # notes/readme.md seen/a.rrd", "notes is a folder without a recording (.rrd)..."),
    ("run --detector notes # notes/readme.md", "notes is a folder; give a bank's .toml or a monitor's .json in it..."),
    ("run results.json", "results.json is no scenario: that is a TOML file, and its name ends in .toml..."),
    (
        "run notes # notes/readme.md",
        "no scenario 'notes': a folder without a .toml; give a TOML file or one of ...",
    ),
    ("run . # key.toml kind.toml", "...a folder that holds key.toml, kind.toml; give a TOML file..."),
    ("inject jam --fault flight.csv --out b.csv", "... is no scenario but, by its name, a log..."),
    ("fly --noise -5 --out x.csv", "--noise is -5.0; it must be a finite number..."),
    ("fly --noise loud --out x.csv", "--noise is 'loud'..."),
    ("fly --out nowhere/x.csv", "...doesn't exist; create it first"),
    ("aircraft --tas -51.5", "--tas is -51.5; it must be a finite number greater than 0..."),
    ("aircraft --tas 400", "...throttle at its limit..."),
    ("aircraft notes # notes/readme.md", "... is no aircraft's folder: no notes.xml (folder NAME holds a model, ..."),
    ("aircraft craft # craft/plane.xml", "...it holds plane.xml: name the folder like the model..."),
    ("campaign seen --report html # seen/a.rrd", "seen holds no parts of a run, as `gtmbench campaign` writes..."),
    ("view", "Missing argument 'RECORDING.rrd|FOLDER'; gtmbench view --help says what there is"),
    # names that were nearly right
    *((line, f"...; did you mean '{meant}'?") for line, meant in NEARLY),
    # commands and options
    ("monitr flight.csv", "No such command 'monitr'. Did you mean 'monitor'?"),
    ("flight.csv", "No such command 'flight.csv'. Did you mean 'gtmbench monitor flight.csv'?"),
    ("monitor", "Missing argument 'LOG|DIR|GLOB...'; gtmbench monitor --help says what there is"),
    ("monitor flight.csv --detecter C", "No such option '--detecter'. Did you mean '--detector'?"),
    ("monitor flight.csv -detector C", "No such option '-d'. Did you mean '--detector'?"),
    ("monitor flight.csv --rate fast", "...value for '--rate': 'fast' is no number; gtmbench monitor --help says ..."),
    ("monitor flight.csv --rate 0 --detector C", "--rate is 0; it must be a finite number, 0.001 or more, at most ..."),
    ("fly --duration -3 --out new.csv", "--duration is -3; it must be a finite number, 0.01 or more, at most 86400"),
    ("fly --duration 3", "the flight goes nowhere: give --out flight.csv, or --live udp:127.0.0.1:14550 to send it"),
    ("fly --live 127.0.0.1:14550", "the target is '127.0.0.1:14550'; give udp:HOST:PORT, such as udp:127.0.0.1:14550"),
    ("fly --out new.csv --speed 2", "--speed is 2, and nothing is sent; add --live udp:127.0.0.1:14550"),
    ("live", "Missing argument 'SOURCE'; gtmbench live --help says what there is"),
    (
        "live flight.csv",
        "... isn't a telemetry log (.tlog); ... monitor flight.csv, and ... live follow:flight.csv",
    ),
    ("live udp:14550:127.0.0.1", "the source is 'udp:14550:127.0.0.1'; give udp:HOST:PORT, tcp:HOST:PORT, serial:..."),
    ("live udp:127.0.0.1:99999", "'udp:127.0.0.1:99999' names port 99999, which doesn't exist; ports are 1 to 65535"),
    ("live nowhere.tlog", "nowhere.tlog: no such file..."),
    ("live udp:127.0.0.1:14550 --detector C", "the detector 'C' isn't calibrated, ... --detector monitor.json, or ..."),
    ("live udp:127.0.0.1:14550 --learn 1", "--learn is 1; it must be a finite number, 10 or more, at most 3600"),
    (
        "live udp:127.0.0.1:14550 --map p=x:rad/s",
        "--map is for lines of CSV (- and follow:); a MAVLink message ...",
    ),
    ("live udp:127.0.0.1:14550 --record live.txt", "--record is 'live.txt'; its name ends in .rrd"),
    ("live udp:127.0.0.1:14550 --save flight.csv", "--save is 'flight.csv'; its name ends in .tlog"),
    ("live udp:127.0.0.1:14550 --speed 2", "--speed is 2, and a link has a speed of its own; it is for a saved ..."),
    ("live udp:127.0.0.1:14550 --key-file nowhere", "--key-file nowhere: No such file ...; give the file that ..."),
    ("live - --say", "--say is for udp:, tcp: and serial:, which can be answered"),
    # names
    ("monitor flight.csv --detector c", "no detector is called 'c'; there are ...; did you mean 'C'?"),
    ("list c", "no bank 'c'; give a TOML file or one of B, ..., paper; did you mean 'C'?"),
    ("run drfit", "no scenario 'drfit'; give a TOML file or one of bias, ...; did you mean 'drift'?"),
    ("inject flight.csv --fault Drift --out b.csv", "no scenario 'Drift'; ...; did you mean 'drift'?"),
    ("aircraft GTM", "no aircraft 'GTM'; there are gtm and JSBSim's own ...; did you mean 'gtm'?"),
    ("fly --excitation multisin --out x.csv", "no excitation 'multisin'; there are ...; did you mean 'multisine'?"),
    (
        "calibrate flight.csv --inputs p,q,Phi --outputs r --healthy 0:40",
        "flight.csv: bank ... and Phi isn't there; ...; did you mean 'phi'?",
    ),
    # files and folders
    ("monitor flihgt.csv # flight.csv", "flihgt.csv: no such file; did you mean 'flight.csv'?"),
    ("monitor day1.csv # flights/day1.csv", "day1.csv: no such file; did you mean 'flights/day1.csv'?"),
    ("monitor nowhere/flight.csv # flight.csv", "nowhere/flight.csv: no such file; did you mean 'flight.csv'?"),
    ("monitor flight.csv --detector montior.json # monitor.json", "montior.json: ...; did you mean 'monitor.json'?"),
    ("monitor flight.csv --healthy day1.csv # flights/day1.csv", "--healthy: day1.csv: ... mean 'flights/day1.csv'?"),
    ("monitor flights # flights/day1.csv flights/day2.csv", "logs found: 2; ... go into a folder: give --out DIR"),
    ("monitor notes --out fleet # notes/readme.md", "notes is a folder that holds no log; give one that does, or ..."),
    ("monitor flights/*.ulg --out fleet # flights/day1.csv", "no file is called as flights/*.ulg; give a folder, ..."),
    ("score flights # flights/day1.csv", f"flights is a folder; give the logs in it, as flights/*.csv; {READ}"),
    ("campaign flight.csv --report html", "flight.csv is no folder; give the one that `gtmbench campaign` has written"),
    ("run flight.csv", "flight.csv is no scenario but, by its name, a log; watch it: gtmbench monitor flight.csv"),
    ("view flight.csv", "flight.csv is no recording but, by its name, a log; watch it: gtmbench monitor flight.csv"),
    ("monitor monitor.json", f"monitor.json is no log but, ... `gtmbench monitor LOG --detector monitor.json`; {READ}"),
    ("monitor flight.csv --detector flights/day1.csv", "flights/day1.csv is no detector but, by its name, a log; ..."),
    ("monitor flight.csv --detector results.json", "... it isn't a monitor of gtmbench; `gtmbench calibrate` ..."),
    # what a file is
    ("monitor empty.csv", f"empty.csv is empty; {READ}"),
    ("monitor header.csv", "header.csv: it names columns, and holds no row of values below them"),
    (
        "monitor headless.csv",
        "headless.csv: no channels ...; no header: columns are called by their numbers, as ...",
    ),
    ("monitor book.csv", "book.csv isn't a readable Excel workbook: ..."),
    ("monitor book.xlsx", "book.xlsx isn't a readable Excel workbook: ..."),
    ("monitor old_book.csv", "old_book.csv is a spreadsheet's workbook; save its sheet as CSV, ..."),
    ("monitor zipped.csv", "zipped.csv: ..."),
    ("monitor binary.csv", "binary.csv is of no format that is known (...); export the log as CSV; ..."),
    ("monitor json.csv", f"json.csv begins as a file of JSON does, not as a log; export the log as CSV; {READ}"),
    ("monitor page.csv", "page.csv begins as a file of HTML or XML does, not as a log; ..."),
    ("monitor flight.mat", "flight.mat isn't a readable MATLAB file: ..."),
    ("monitor flight.ulg", f"flight.ulg doesn't begin as a .ulg file does (it begins b'time_s,p'); {READ}"),
    # what a table holds
    (
        "monitor comma.csv",
        "...: rows have more cells than the 7 ... If decimals have commas, cells need semicolon...",
    ),
    ("monitor wide.csv", "wide.csv: rows have more cells than the 3 that its first line names; is that the header..."),
    ("monitor words.csv --detector C", "words.csv: no channel 'p': column 'p_deg_s' looks like p, but holds text; ..."),
    ("monitor nan.csv --detector C", "nan.csv: p: 'p_deg_s' holds 0 samples; at least 20 are needed"),
    ("monitor one_row.csv", "one_row.csv: rows that have a time: 1; a log has more"),
    ("monitor short.csv", "short.csv: p, q, r: 12 samples; give at least 20"),
    ("monitor two_seconds.csv --healthy 0:30", "a healthy record of 2 s is too short to ...; give at least 5 s, ..."),
    # time
    ("monitor slow.csv --healthy 0:30", "... has 1 sample a second; at least 2.5 are needed, better 10 or more; ..."),
    ("monitor slow.csv --detector monitor.json", "...: samples of p come at 1 Hz, and the monitor watches at 100 ..."),
    ("monitor shuffled.csv --healthy 0:30", "...: ... steps go forward, ... back; sort the rows by time; or ..."),
    ("monitor ms.csv --healthy 0:30", "... has 0.025 samples a second; ...; by its steps ...: --map time=time_s:ms"),
    ("monitor us.csv --healthy 0:30", "us.csv: column 'time_s' rises by 40000 s a sample, ...: --map time=time_s:us"),
    ("monitor two_times.csv --healthy 0:30", "...: columns 't_s' and 'timestamp_s' ... choose: --map time=t_s:s"),
    # columns and their units
    ("monitor small.csv --healthy 0:30", "...: gyro_x, gyro_y, gyro_z may be in rad/s or in deg/s: --units rad or ..."),
    (
        "monitor letters.csv --healthy 0:30",
        "...: nothing looks like p, q or r: --map p=COLUMN:rad/s ...",
    ),
    ("monitor bare.csv --map p:gyro_x:rad/s", "--map 'p:gyro_x:rad/s' isn't CHANNEL=COLUMN:UNIT; for example ..."),
    (
        "monitor bare.csv --map p=gyrox:rad/s",
        "... p=gyrox:rad/s: no column 'gyrox'; ...; did you mean 'gyro_x'?",
    ),
    ("monitor bare.csv --map P=gyro_x:deg/s", f"--map 'P=gyro_x:deg/s': 'P' {NO_CHANNEL}"),
    ("monitor bare.csv --map gyro_x=p:deg/s", f"--map 'gyro_x=p:deg/s': 'gyro_x' {NO_CHANNEL}"),
    # what is healthy, and by what
    ("monitor flight.csv --healthy 500:600", "500..600 s hold nothing of flight.csv, which runs from 0 to 79.96 s..."),
    ("monitor flight.csv --healthy 30:0", "--healthy is '30:0'; the start must come before the end; ... mean 0:30?"),
    ("monitor flight.csv --healthy 0-30", f"--healthy is '0-30', {SPAN}; did you mean 0:30?"),
    ("monitor flight.csv --healthy 0:2", "a healthy record of 2.04 s is too short to ...; give at least 5 s, ..."),
    ("monitor flight.csv --healthy flight.csv", "flight.csv is the log that is watched; give a span of it ..."),
    ("monitor flight.csv --detector monitor.json --healthy 0:9", "a calibrated monitor isn't identified anew; ..."),
    # what is written
    ("monitor flight.csv --report there.png", "there.png exists; give another --report, or --force ..."),
    ("monitor flight.csv --out fleet --report x.html", "--report is of one log..."),
    ("monitor flight.csv --report new.jpg", "--report is 'new.jpg'; its name ends in .html or .png"),
    ("monitor flight.csv --report nowhere/new.png", "can't write ...nowhere doesn't exist; create it first"),
    ("inject flight.csv --fault drift", "--out is missing; name the broken log to write"),
    ("fly --out new.xlsx", "new.xlsx: a flight is written as .csv or .parquet, not as '.xlsx'"),
    ("run --new drift", "'drift' should end in .toml, as drift.toml"),
]

# what is read as it is meant, with a word on it
READ_RIGHT = [
    ("german.csv", "gyros     p q r          25 Hz"),
    ("tabs.csv", "gyros     p q r          25 Hz"),
    ("bom.csv", "gyros     p q r          25 Hz"),
    ("utf16.csv", "read as utf-16"),
    ("joined.csv", "rows that repeat the header: 1; were files put together?"),
    ("seconds.csv", "gyros     p q r          25 Hz"),
    ("words.csv", "column 'p_deg_s': 1333 of 2000 cells hold no number, such as 'OVF'"),
]

# what only the motion shows is a verdict: nothing can be told, why, and what to type
VERDICTS = [
    ("gyros_in_radians.csv", "p, q and r are 57 times too small: rad/s taken for deg/s", "--map p=p_deg_s:rad/s"),
    ("radians.csv", "phi, theta and psi are 57 times too small: rad taken for deg", "--map phi=phi_deg:rad"),
    ("degrees.csv", "phi, theta and psi are 57 times too large: deg taken for rad", "--map phi=phi_rad:deg"),
    ("swapped.csv", "p and q are swapped", "--map q=p_deg_s:deg/s --map p=q_deg_s:deg/s"),
    ("dead.csv", "p reads 0.25 all the time: dead, or held", ""),
]


@pytest.fixture
def type_it(cli):
    """Return a function that types a line where the files are that it names, and those behind #."""

    def typed(line):
        command, _, there = line.partition(" # ")
        for name in [*shlex.split(command), *there.split()]:
            if name in FILES:
                content, path = FILES[name](), Path(name)
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return cli(*shlex.split(command))

    return typed


@pytest.mark.parametrize(("line", "said"), by_day(MISTAKES, 85), ids=[line for line, _ in MISTAKES])
def test_a_mistake_ends_in_one_line_that_says_what_to_type(type_it, tmp_path, line, said):
    code, _, err = type_it(line)
    assert {path.name for path in tmp_path.rglob("*")} <= {part for name in FILES for part in Path(name).parts}
    assert (code, err.count("\n")) == (2, 1), err
    expected = ".*".join(map(re.escape, f"gtmbench: {said}".split("...")))
    assert re.fullmatch(expected, err.removesuffix("\n")), err


@pytest.mark.parametrize(("name", "said"), READ_RIGHT)
def test_what_can_be_read_right_is(type_it, name, said):
    code, out, err = type_it(f"monitor {name} --list")
    assert (code, err) == (0, "")
    assert said in out
    assert "r_deg_s" in out


@pytest.mark.parametrize(("name", "why", "typed"), VERDICTS)
def test_what_the_motion_shows_is_a_verdict(type_it, name, why, typed):
    code, out, err = type_it(f"monitor {name} --detector C --healthy 0:30")
    assert (code, err) == (3, "")
    assert why in out
    assert typed in out


def test_a_log_without_permission_says_so(type_it, cli, monkeypatch):
    def locked(*_, **__):
        raise PermissionError(13, "Permission denied")

    assert type_it("monitor flight.csv --list")[0] == 0
    monkeypatch.setattr(Path, "open", locked)  # root reads whatever it is
    said = "gtmbench: flight.csv can't be read: its permissions don't allow it; type: chmod u+r flight.csv\n"
    assert cli("monitor", "flight.csv", "--list") == (2, "", said)


def test_what_nobody_foresaw_is_no_fault_found(cli, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("gtmbench.bench.flight.trim", broken)
    code, out, err = cli("aircraft")
    assert (code, out) == (2, "")
    assert err.endswith("gtmbench: this shouldn't have happened (ZeroDivisionError: two lines); please report it\n")
    code, out, _ = cli("aircraft", "--json")
    assert json.loads(out)["exit_code"] == code == 2
