"""What becomes of files: bits flipped, disks full, two writers, interruptions. ``python -m tests.ordeals --help``.

Every ordeal runs the commands as a user would, in sessions of their own, forked from a process that has imported
everything, and holds what they leave against what an undisturbed run leaves, byte for byte. It prints a line a failure
and one of figures; it ends with 1 where anything failed.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow.parquet as pq

import gtmbench as gb
from gtmbench.check.baseline import new_baseline, read_reference, write_figures
from gtmbench.check.figures import figures_of
from gtmbench.files.folders import SUMS, read_sums
from gtmbench.jobs.parts import read_parts
from gtmbench.study.run import run_study
from gtmbench.study.scenario import load_scenario
from tests.check.test_check import SHORT
from tests.helpers import small_benchmark
from tests.helpers.campaigns import TINY
from tests.helpers.log_makers import flight, telemetry
from tests.study.campaign.test_campaign_cluster import Cluster

ROOT = Path(__file__).parent.parent
FORKS = """
import json, os, sys
import pandas, jsbsim, filelock, pyarrow.parquet, pyarrow.csv, scipy.signal, matplotlib.figure
import gtmbench.api, gtmbench.report.campaign, gtmbench.log.watch, gtmbench.check.check
from pathlib import Path
from gtmbench.cli.app import main
from gtmbench.study.benchmark import definition
definition.shipped_benchmarks = lambda: {"gtmbench-2": Path("small.toml")}  # of seconds, not hours
for line in sys.stdin:
    told = json.loads(line)
    process = os.fork()
    if not process:
        os.setsid()
        os.environ.update(told["environment"])
        os.chdir(told["folder"])
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(told[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        main(told["arguments"])
    print(process, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
"""
WATCH = ("--detector", "own.toml")
OWN = """title = "q from p"
suspects = ["q", "p"]
residuals = [{ output = "q", inputs = ["p"], look_back_s = 0.2, look_ahead_s = 0.2 }]
alarm = { statistic = "energy", windows_s = [0.5, 2.0], two_sided = false }
"""
COMMANDS = {
    "run": ["run", "short.toml", "--out", "study", "--force"],
    "campaign": ["campaign", "tiny.toml", "--out", "out", "--jobs", "2", "--resume"],
    "monitor": [
        "monitor",
        "log.csv",
        *WATCH,
        "--healthy",
        "0:30",
        "--record",
        "m.rrd",
        "--report",
        "m.png",
        "--report",
        "m.html",
        "--force",
    ],
    "fleet": ["monitor", "logs", *WATCH, "--healthy", "0:30", "--out", "fleet", "--resume"],
    "calibrate": ["calibrate", "log.csv", "--detector", "limits", "--out", "c.json", "--force"],
    "inject": ["inject", "log.csv", "--fault", "fault.toml", "--out", "broken.csv", "--force"],
    "fly": ["fly", "--duration", "60", "--out", "f.parquet", "--force"],
    "report": ["campaign", "done", "--report", "html", "--out", "r.html", "--force"],
    "diff": ["verify", "a.rrd", "--against", "b.rrd", "--overlay", "o.rrd", "--force"],
    "check": ["check", "mine.toml", "--update"],
    "page": ["monitor", "log.csv", "--report", "m.html", "--force"],
    "map": ["monitor", "log.csv", *WATCH, "--map", "map.toml", "--force"],
    "export": ["export", str(ROOT / "gtmbench/baselines/bank-C.json"), "--out", "c", "--force"],
    "autopilot": ["aircraft", "--autopilot", "--out", "gains.toml", "--force"],
    "new": ["run", "--new", "mine-new.toml"],
    "rescue": ["fly", "--rescue", "--out", "rescue.rrd", "--figure", "rescue.png", "--force"],
    "demo": ["demo", "--out", "shown", "--force"],
    "flown": ["fly", "--duration", "20", "--out", "f.csv", "--noise", "t2", "--force"],
    "words": ["campaign", "done", "--report", "md", "--out", "r.md", "--force"],
    "junit": ["check", "mine.toml", "--junit", "j.xml"],
    "flights": ["benchmark", "--export", "flights", "--csv", "--jobs", "2"],
    "scored": ["benchmark", "--detector", "limits", "--any-versions", "--out", "scored", "--jobs", "2"],
    "live": ["live", "link.tlog", "--learn", "30", "--save", "saved.tlog", "--record", "live.rrd", "--force"],
}
# what stays, for the next run to go on, or to be looked at
KEPT = {
    "campaign": "out/",
    "fleet": "fleet/",
    "flights": "flights/",
    "scored": "scored/",
    "live": ("saved.tlog", "live.rrd"),
}
FOUND = {
    "diff": 1,
    "monitor": 3,
    "map": 3,
    "fleet": 3,
    "live": 3,
}  # exit codes that are as good as 0 here: what was found
FAILURES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
FULL = "full disk"  # from then on no file grows beyond a line
# SIGXCPU: a limit of time
ENDINGS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGXCPU, FULL)
FAULT = '[[faults]]\nkind = "bias"\nchannels = ["p"]\nonset_s = 20.0\nsize = 3.0\n'
LINE = 1000
ENDED = (".csv", ".parquet", ".rrd", ".png", ".html", ".md", ".xml", ".json", ".toml", ".tlog")


class Forks:
    """Runs of the command line, one at a time, each a session of its own."""

    def __init__(self, preload=""):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "LD_PRELOAD": str(preload)}
        command = [sys.executable, "-c", FORKS]
        self._server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)

    def begin(self, arguments, folder, err, environment=()):
        told = {"arguments": [*arguments, "-q"], "folder": str(folder), "out": os.devnull, "err": str(err)}
        told["environment"] = dict(environment)
        self._server.stdin.write(json.dumps(told).encode() + b"\n")
        self._server.stdin.flush()
        return int(self._server.stdout.readline())

    def code(self):
        return int(self._server.stdout.readline())

    def run(self, arguments, folder, err, environment=()):
        self.begin(arguments, folder, err, environment)
        return self.code()

    def end(self):
        self._server.stdin.close()
        self._server.wait()


def prepare(given, forks):
    """Make what the commands are given."""
    given.mkdir()
    for name, text in (("short", SHORT), ("tiny", TINY), ("fault", FAULT), ("small", small_benchmark.TINY)):
        (given / f"{name}.toml").write_text(text)
    (given / "logs").mkdir()
    truth = gb.fly(excitation="multisine", duration_s=60.0, seed=1)
    for seed, name in enumerate(("log", "logs/a", "logs/b", "logs/c")):
        record = gb.measure(truth, snr=50, seed=seed).select(["p", "q", "r", "phi", "theta", "psi"])
        gb.write_log(record, given / f"{name}.csv")
    (given / "own.toml").write_text(OWN)
    scenario = load_scenario(given / "short.toml")
    text = new_baseline(given / "mine.toml", scenarios=[str(given / "short.toml")], detector=None)
    write_figures(given / "mine.toml", text, seed=1, groups=figures_of(run_study([scenario])))
    err = given / "err"
    assert forks.run(["campaign", "tiny.toml", "--out", "done"], given, err) == 0, err.read_text()
    for seed, name in ((1, "a"), (2, "b")):
        code = forks.run(["run", "short.toml", "--no-figures", "--seed", str(seed), "--out", name], given, err)
        assert code == 0, err.read_text()
        (given / name / "study.rrd").rename(given / f"{name}.rrd")
        shutil.rmtree(given / name)
    err.unlink()
    telemetry(given / "link.tlog", flight(60.0))


def left_by(folder):
    """Return the bytes of every file that stands there and isn't given; of recordings, whether they are whole."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {
        path.relative_to(folder).as_posix(): content_of(path)
        for path in files
        if path.name != "err" and not path.is_relative_to(folder / "logs")
    }


def content_of(path):
    if path.suffix == ".rrd":
        content = path.read_bytes()
        return f"a recording that is {'whole' if b'RRF2FOOT' in content[-12:] else 'cut'}"
    if path.suffix == ".xml":  # it says how long it took
        return re.sub(rb' time(stamp)?="[^"]*"', b"", path.read_bytes())
    if "scored" in path.parts:  # scores, pages and entries of a benchmark say what a sample took, a figure of its own
        if path.suffix == ".parquet":
            return pq.read_table(path).replace_schema_metadata().to_pydict()
        return path.read_bytes() if path.suffix in (".csv", ".png") else re.sub(rb"[\d\s|-]", b"", path.read_bytes())
    if path.name == SUMS:
        sums = read_sums(path)
        return [(name, None if name.endswith(".rrd") else digest) for name, digest in sums.items()]
    return path.read_bytes()


def place(folder, given):
    """Make a folder to work in, with what is given as links, but what is changed in its place."""
    folder.mkdir(exist_ok=True)
    for path in given.iterdir():
        if path.name == "mine.toml":
            shutil.copy(path, folder)
        else:
            (folder / path.name).symlink_to(path)


class Ordeals:
    """Ordeals of the commands, and what undisturbed runs of them leave, in how much time."""

    def __init__(self, folder, seed):
        self.folder, self.draw = folder, np.random.default_rng(seed)
        self.forks, self.failed = Forks(), 0
        prepare(folder / "given", self.forks)
        self.left, self.took_s = {}, {}

    def learn(self, name):
        """Return what an undisturbed run leaves."""
        if name not in self.left:
            work, err = self.folder / f"reference-{name}", self.folder / "err"
            place(work, self.folder / "given")
            began = time.monotonic()
            code = self.forks.run(COMMANDS[name], work, err)
            self.took_s[name] = time.monotonic() - began
            assert code in (0, FOUND.get(name)), (name, code, err.read_text())
            self.left[name] = left_by(work)
        return self.left[name]

    def hold(self, what, *checks):
        """Count an ordeal that was failed, and say how."""
        wrong = [said for said, holds in checks if not holds]
        if wrong:
            self.failed += 1
            print(f"FAILED {what}: {'; '.join(wrong)}", flush=True)

    def differs(self, name, folder):
        """Say by name which files aren't those of an undisturbed run."""
        left, meant = left_by(folder), self.learn(name)
        return sorted(each for each in {*left, *meant} if left.get(each) != meant.get(each))

    def count(self, number):
        """Say now and then how far it is."""
        if number % 20 == 0:
            print(f"... {number}, {self.failed} failed, {time.strftime('%H:%M:%S')}", flush=True)

    def said(self, err):
        """Return what was said, and whether that is one line, or one for each output of a link."""
        lines = [line for line in err.read_text().splitlines() if not line.startswith("note: ")]
        is_of_link = bool(lines) and all(line.startswith("gtmbench: not all ") for line in lines)
        return lines, is_of_link or (len(lines) == 1 and lines[0].startswith("gtmbench: "))

    def writes(self, tries, commands):
        """Let every change of the disk from the n-th on fail, in four ways, of each command in turn, for growing n."""
        shim, told = self.folder / "shim.so", Counter()
        source = Path(__file__).with_name("full_disk.c")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", shim, source, "-ldl"], check=True)
        forks = Forks(shim)
        # of each, which change fails next
        left = {(name, failure): 0 for name in commands or COMMANDS for failure in FAILURES}
        for number in range(tries):
            if not left:
                break
            self.count(number)
            name, failure = list(left)[number % len(left)]
            work, err, nth = self.folder / "writes", self.folder / "err", left[name, failure]
            place(work, self.folder / "given")
            before = left_by(work)
            environment = {"FULL_IN": str(work), "FULL_FROM": str(nth), "FULL_AS": str(failure)}
            code = forks.run(COMMANDS[name], work, err, environment)
            after = left_by(work)
            changed = sorted(each for each in {*before, *after} if before.get(each) != after.get(each))
            outputs = [each for each in changed if is_seen(each) and not each.startswith(KEPT.get(name, "-"))]
            what, text = f"{name}, change {nth} fails as {errno.errorcode[failure]}, exit {code}", err.read_text()
            if code == 2:  # a link is watched to its end all the same
                told[errno.errorcode[failure]] += 1
                self.hold_words(what, err, failure)
                is_cut = after.get("live.rrd") == "a recording that is cut"
                self.hold(
                    what,
                    (f"half output: {outputs}", not outputs),
                    (f"a recording is cut: {text}", not is_cut or "not all recorded" in text),
                )
                left[name, failure] += 1 + int(self.draw.integers(0, 1 + nth // 2))
            else:
                lacks = [each for each in COMMANDS[name] if Path(each).suffix in ENDED and not (work / each).exists()]
                self.hold(
                    what,
                    (f"another exit code: {text}", code in (0, FOUND.get(name))),
                    ("a recording is cut", "a recording that is cut" not in after.values()),
                    (f"no output: {lacks}", not lacks and (outputs or name in KEPT)),
                )
                del left[name, failure]
            shutil.rmtree(work)
        forks.end()
        print(f"writes: {dict(told)} failed, {self.failed} wrongly, not tried to the end: {sorted(left)}", flush=True)

    def hold_words(self, what, err, failure):
        """Hold what is said to one line, which names an output and the reason, and not the input."""
        lines, is_one = self.said(err)
        text = " ".join(lines)
        is_named = ("can't write" in text or "not all " in text) and text.count(os.strerror(failure)) == len(lines)
        self.hold(
            what,
            (f"not one line: {lines}", is_one),
            (f"no output and reason: {lines}", is_named),
            (f"the input is blamed: {lines}", "readable" not in text and "log.csv:" not in text),
        )

    def writers(self, tries):
        """Begin a command twice, the second some time later, while the first is at work."""
        other, told = Forks(), 0
        shard = ["campaign", "tiny.toml", "--out", "out", "--shard", "1/2"]
        for number in range(tries):
            self.count(number)
            name = ("run", "campaign", "fleet", "report", "shard")[number % 5]
            alone = (
                shard if name == "shard" else [each for each in COMMANDS[name] if each not in ("--force", "--resume")]
            )
            meant = None if name == "shard" else self.learn(name)
            work = self.folder / f"writers-{number}"
            place(work, self.folder / "given")
            errs = self.folder / "err", self.folder / "err-2"
            self.forks.begin(alone, work, errs[0])
            time.sleep(self.draw.uniform(0.0, 0.4) * self.took_s.get(name, 1.0))
            other.begin(alone, work, errs[1])
            codes = self.forks.code(), other.code()
            lost = [self.said(err) for err, code in zip(errs, codes, strict=True) if code == 2]
            told += len(lost)
            won = sum(code in (0, FOUND.get(name)) for code in codes)
            what = f"two writers, {name}, exit {codes}"
            self.hold(what, ("not one won", won == 1), ("not one told", len(lost) == 1 and lost[0][1]))
            if meant is not None:
                self.hold(what, (f"other files: {self.differs(name, work)}", not self.differs(name, work)))
            shutil.rmtree(work)
        other.end()
        print(f"writers: {tries} tries, {told} told, {self.failed} failed", flush=True)

    def kills(self, tries, names):
        """Interrupt commands at any instant, in five ways; then run them to their end."""
        cluster, at_work = None, 0
        for number in range(tries):
            self.count(number)
            name = (names or [*COMMANDS, "dask"])[number % (len(names) or len(COMMANDS) + 1)]
            arguments, of = COMMANDS["campaign" if name == "dask" else name], "campaign" if name == "dask" else name
            if name == "dask":
                cluster = cluster or Cluster(self.folder, workers=2)
                arguments = [*arguments[:4], "--resume", "--scheduler", cluster.address]
            self.learn(of)
            work, err = self.folder / f"kills-{number}", self.folder / "err"
            place(work, self.folder / "given")
            ending = ENDINGS[int(self.draw.integers(len(ENDINGS)))]
            process = self.forks.begin(arguments, work, err)
            time.sleep(self.draw.uniform(0.0, 1.0) * self.took_s[of])
            with contextlib.suppress(ProcessLookupError):
                interrupt(process, ending)
            code = self.forks.code()
            at_work += code not in (0, FOUND.get(of))
            what = f"{name} interrupted by {getattr(ending, 'name', ending)}, exit {code}"
            told = {FULL: 2, signal.SIGINT: 130, signal.SIGTERM: 143}.get(ending)
            legal = {0, FOUND.get(of, 0), told, None if ending == FULL else -ending}
            self.hold(what, ("another exit code", code in legal), ("processes left", gone(process)))
            if code == 2:
                lines, is_one = self.said(err)
                self.hold(what, (f"no line with the reason: {lines}", is_one and "File too large" in lines[0]))
            half = [each for each in self.differs(of, work) if each in left_by(work) and is_output(each)]
            half = [each for each in half if of != "live" or each not in KEPT[of]]
            if (
                of in ("campaign", "fleet")
                and (work / arguments[arguments.index("--out") + 1] / "manifest.json").exists()
            ):
                parts = read_parts(work / arguments[arguments.index("--out") + 1])
                self.hold(what, (f"damaged parts {parts.damaged()}", not parts.damaged()))
                half = []
            self.hold(what, (f"half output: {half}", not half))
            time.sleep(1.1)  # a hidden folder that is younger may be one that somebody else is making
            again = self.forks.run(arguments, work, err)
            stands = of == "new" and again == 2 and "exists" in err.read_text()
            self.hold(f"{what}, again", (f"exit {again}: {err.read_text()}", again in (0, FOUND.get(of)) or stands))
            hidden = [path.name for path in work.rglob(".*")]
            self.hold(f"{what}, again", (f"left {hidden}", not hidden))
            self.hold(f"{what}, again", (f"other files: {self.differs(of, work)}", not self.differs(of, work)))
            shutil.rmtree(work)
        if cluster is not None:
            cluster.end()
        print(f"kills: {tries} tries, {at_work} of them at work, {self.failed} failed", flush=True)

    def flips(self, tries):
        """Flip one bit of a part, a monitor, a baseline; what is read must be what was written, or a word is said."""
        given = self.folder / "given"
        self.learn("calibrate")
        (given / "c.json").write_bytes(self.left["calibrate"]["c.json"])
        parts = read_parts(given / "done")

        def part():
            return read_parts(given / "done").read().to_pylist()

        def monitor():
            return gb.load_monitor(given / "c.json").figures()

        def baseline():
            reference = read_reference(given / "mine.toml")
            reference.check_recorded()
            return repr(reference), repr(reference.recorded)

        places = ((part, parts.path(0)), (monitor, given / "c.json"), (baseline, given / "mine.toml"))
        for read, path in places:
            whole, meant, silent, refused = path.read_bytes(), repr(read()), 0, 0
            for bit in self.draw.integers(0, 8 * len(whole), tries):
                flipped = bytearray(whole)
                flipped[bit // 8] ^= 1 << int(bit % 8)
                path.write_bytes(bytes(flipped))
                try:
                    with gb_notes() as told:
                        silent += repr(read()) != meant and not told
                except gb.GtmbenchError:
                    refused += 1
            path.write_bytes(whole)
            self.failed += silent
            print(f"flips: {path.name}: {tries} bits, {refused} refused, {silent} read as another value", flush=True)


@contextlib.contextmanager
def gb_notes():
    import warnings

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        yield told


def interrupt(process, ending):
    """End a process, Ctrl-C with all of its session; or let its files grow no more."""
    if ending == FULL:
        resource.prlimit(process, resource.RLIMIT_FSIZE, (LINE, LINE))
    elif ending == signal.SIGINT:
        os.killpg(process, ending)
    else:
        os.kill(process, ending)


def is_seen(name):
    """Whether a file has a name that a user would look at."""
    return not any(part.startswith(".") for part in Path(name).parts)


def is_output(name):
    """Whether it is one, and not what was given."""
    return is_seen(name) and name != "mine.toml"


def gone(session):
    """Whether no process of a session is left, a minute of a busy machine after its first has ended."""
    for _ in range(600):
        left = subprocess.run(["ps", "-o", "stat=", "-s", str(session)], capture_output=True, text=True, check=False)
        if not any(line.strip() and not line.startswith("Z") for line in left.stdout.splitlines()):
            return True
        time.sleep(0.1)
    return False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ordeal", choices=["flips", "writes", "writers", "kills"])
    parser.add_argument("--tries", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="*", default=(), help="of kills and writes; by default all")
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        ordeals = Ordeals(Path(folder), given.seed)
        try:
            more = (given.commands,) if given.ordeal in ("kills", "writes") else ()
            getattr(ordeals, given.ordeal)(given.tries, *more)
        finally:
            ordeals.forks.end()
    sys.exit(ordeals.failed > 0)


if __name__ == "__main__":
    main()
