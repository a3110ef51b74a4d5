import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import gtmbench as gb
from gtmbench.jobs.processes import Lost, completed, spread, survived
from gtmbench.jobs.threads import on_one_thread
from tests.helpers.night import by_day

SHARED = {}


def begin(value):
    SHARED["value"] = value


def add(task):
    return task + SHARED["value"], os.getpid()


def die(_):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("processes", by_day([1, 2]))
def test_results_come_in_order_from_processes_that_began_as_told(processes):
    told = []
    begun = partial(begin, 10)
    rows = spread(add, range(5), processes=processes, step="add", begin=begun, progress=lambda *step: told.append(step))
    assert [value for value, _ in rows] == [10, 11, 12, 13, 14]
    assert os.getpid() not in {process for _, process in rows}
    assert told == [("add", done, 5) for done in range(6)]
    assert SHARED == {}


def test_what_the_work_raises_comes_as_it_is():
    with pytest.raises(ZeroDivisionError):
        spread(partial(divmod, 1), [1, 0], processes=2, step="divide")


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_process_that_is_killed_is_told_as_an_error_of_ours():
    with pytest.raises(gb.GtmbenchError, match="killed"):
        spread(die, [1, 2], processes=2, step="die")


def slow(seconds):
    time.sleep(seconds)
    return seconds


def test_what_is_made_comes_as_soon_as_it_is_made_and_tasks_are_taken_as_they_are_needed():
    taken = []

    def tasks():
        for i in range(50):
            taken.append(i)
            yield 1.0 if i == 0 else 0.0

    found = completed(slow, tasks(), processes=2)
    number, _ = next(found)
    assert number != 0
    assert len(taken) < 10
    assert sorted([number, *(i for i, _ in found)]) == list(range(50))


ORPHANED = """
import os, signal, sys, time
from gtmbench.jobs.threads import on_one_thread
from gtmbench.jobs.processes import completed
from tests.shared.test_processes import pid_and_sleep
if __name__ == "__main__":
    for _, (pid, parent) in completed(pid_and_sleep, [0.0, 60.0, 60.0, 60.0], processes=2):
        print(pid, flush=True)
        os.kill(parent, signal.SIGKILL)
"""


def pid_and_sleep(seconds):
    time.sleep(seconds)
    return os.getpid(), os.getppid()


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_processes_end_with_the_one_that_wants_their_work_even_if_it_is_killed(tmp_path):
    script = tmp_path / "main.py"
    script.write_text(ORPHANED)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    run = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, timeout=60)
    assert run.returncode == -signal.SIGKILL, run.stderr
    pid, patience = int(run.stdout), 100
    while Path(f"/proc/{pid}").exists() and patience:
        time.sleep(0.1)
        patience -= 1
    assert patience > 0


def hostile(task):
    if task == "die":
        die(task)
    if task == "hang":
        time.sleep(600.0)
    return task


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_tasks_that_kill_their_process_or_never_end_are_lost_and_the_others_survive():
    tasks = ["a", "die", "hang", "b", "c"]
    told = dict(survived(hostile, tasks, processes=2, limit_s=3.0))
    assert [told[place] for place in (0, 3, 4)] == ["a", "b", "c"]
    assert isinstance(told[1], Lost)
    assert isinstance(told[2], Lost)
    assert (told[1].is_late, told[2].is_late) == (False, True)


def test_of_survivors_too_what_the_work_raises_comes_as_it_is():
    with pytest.raises(ZeroDivisionError):
        list(survived(partial(divmod, 1), [1, 0], processes=1, limit_s=60.0))


def _asked(_):
    return os.environ.get("OPENBLAS_NUM_THREADS")


@pytest.mark.parametrize(("here", "there"), by_day([(None, "1"), ("3", "3")]))
def test_each_process_computes_on_one_thread_unless_somebody_asks_for_more(here, there, monkeypatch):
    if here is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    else:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", here)
    assert [told for _, told in completed(_asked, range(3), processes=2)] == [there] * 3
    assert os.environ.get("OPENBLAS_NUM_THREADS") == here


@pytest.mark.parametrize("asked", [None, "2"])
def test_a_call_from_python_computes_on_one_thread_unless_somebody_asks_for_more(asked, monkeypatch):
    """Who calls has loaded NumPy with as many as there are cores, and has them again afterwards."""
    if asked is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    else:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", asked)

    def threads():
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        assert on_one_thread(threads)() == ({1} if asked is None else {2})
        assert threads() == {2}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == asked
