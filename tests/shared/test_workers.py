"""Whoever does long work, the same comes of it; work of another version is refused where it is done."""

from functools import partial

import pytest

import gtmbench as gb
from gtmbench.jobs import workers
from gtmbench.jobs.workers import Workers, done
from tests.helpers.campaigns import fails
from tests.helpers.night import by_day


def power(exponent, base):
    return base**exponent


@pytest.mark.parametrize("processes", by_day([1, 2]))
def test_results_stand_in_the_order_of_the_tasks(processes):
    told = []
    found = Workers(processes=processes).spread(
        partial(power, 2), [3, -1, 4], step="power", progress=lambda *seen: told.append(seen)
    )
    assert found == [9, 1, 16]
    assert told == [("power", number, 3) for number in range(4)]


@pytest.mark.parametrize("processes", by_day([1, 2]))
def test_an_error_of_the_work_comes_as_it_is(processes):
    with pytest.raises(gb.InputError, match="not 3"):
        Workers(processes=processes).spread(fails, [3], step="fail")


def test_work_of_another_version_is_refused_where_it_is_done(monkeypatch):
    sent = []

    def completed(_work, tasks, *, begin, **_):
        sent.append((begin.args[0], list(tasks)))
        return iter(())

    monkeypatch.setattr(workers, "completed", completed)
    list(Workers(processes=2).completed(partial(power, 3), [2]))
    [(order, [packed])] = sent
    assert done(order, packed) == 8
    older = tuple((name, "0.2" if name == "gtmbench" else version) for name, version in order.versions)
    with pytest.raises(gb.InputError, match=r"a worker \(process \d+ on .*\) has gtmbench \S+ instead of 0.2"):
        done(order._replace(versions=older), packed)
