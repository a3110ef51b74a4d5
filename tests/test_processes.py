import os
import signal
from functools import partial

import pytest

import gtmbench as gb
from gtmbench.processes import spread

SHARED = {}


def begin(value):
    SHARED["value"] = value


def add(task):
    return task + SHARED["value"], os.getpid()


def die(_):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("processes", [1, 2])
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
