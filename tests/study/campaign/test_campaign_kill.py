"""Killed at random moments and gone on with: the same in the end."""

import contextlib
import json
import os
import random
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gtmbench.cli.app import main
from tests.helpers.campaigns import results, written

ROOT = Path(__file__).parents[3]
A_MOMENT_S = 1.1
LONGEST_S = 0.3
# A process that has imported everything, and forks itself for each run: importing it for each took most of the time.
FORKS = """
import json, os, sys
import pandas, jsbsim, filelock, pyarrow.parquet, pyarrow.csv
import gtmbench.api, gtmbench.report.campaign
from gtmbench.cli.app import main
for line in sys.stdin:
    process = os.fork()
    if not process:
        main(json.loads(line))
    print(process, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
"""


class Runs:
    """Runs of the command line, one at a time, that can be killed."""

    def __init__(self, forks):
        self._forks = forks

    def killed(self, arguments, out, parts, after_s):
        """Start a run and kill it some time after it has written so many parts; return whether it was still at work."""
        before = count(out)
        self._forks.stdin.write(json.dumps([str(argument) for argument in arguments]).encode() + b"\n")
        self._forks.stdin.flush()
        process = int(self._forks.stdout.readline())
        while not (out.is_dir() and count(out) >= before + parts) and not self._ended(0.002):
            pass
        if not self._ended(after_s):
            os.kill(process, signal.SIGKILL)
        code = int(self._forks.stdout.readline())
        assert code in (0, -signal.SIGKILL)
        return code != 0

    def _ended(self, within_s):
        return bool(select.select([self._forks.stdout], [], [], within_s)[0])


@contextlib.contextmanager
def runs():
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", FORKS]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as forks:
        yield Runs(forks)
        forks.stdin.close()


def count(out):
    return len(list(out.glob("part-*")))


def arguments(campaign, out, jobs=1):
    return ["campaign", campaign, "--out", out, "--resume", "--jobs", jobs, "-q"]


def finished(campaign, out):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments(campaign, out)])
    assert ended.value.code == 0
    return results(out)


def kill(times, seed, folder):
    """Kill runs so many times, going on until each campaign ends; hold what they leave against one that wasn't."""
    moments, campaign = random.Random(seed), written(folder)
    whole = finished(campaign, folder / "whole")
    kills = campaigns = 0
    found = []
    with runs() as running:
        while kills < times:
            out, at_work = folder / f"killed-{campaigns}", True
            while at_work and kills < times:
                jobs = 2 if kills % 10 == 9 else 1
                when = moments.randrange(5), moments.uniform(0.0, LONGEST_S)
                at_work = running.killed(arguments(campaign, out, jobs), out, *when)
                kills += at_work
                found.append(count(out))
            time.sleep(A_MOMENT_S)  # what was made just now may be somebody's who is at work
            assert finished(campaign, out) == whole
            assert not list(out.glob(".gtmbench-*"))
            campaigns += 1
    return kills, found


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_killed_at_a_dozen_random_moments_a_campaign_ends_with_the_same_bytes(tmp_path):
    kills, found = kill(12, 1, tmp_path)
    assert kills == 12
    assert len(set(found)) > 3, "every run was killed at the same place"
