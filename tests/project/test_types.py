"""What users get has types: nothing that is public gives `Any`, but for what is listed here with its reason."""

import collections.abc
import inspect
import typing
from functools import cached_property
from types import SimpleNamespace

import matplotlib.figure
import numpy as np
import pandas as pd

import gtmbench as gb
import gtmbench.testing
from gtmbench import api
from gtmbench.detectors.installation.installation import Installation
from gtmbench.engine.commands import CommandsJudged
from gtmbench.engine.course.judged import CourseJudged
from gtmbench.history.next_motion import NextMotion
from gtmbench.history.standing import Standing
from gtmbench.log.judging.certificate import Certificate

PANDAS = SimpleNamespace(DataFrame=pd.DataFrame, Series=list)  # its own Series takes no [type] at run time
OURS = (CommandsJudged, CourseJudged, Certificate, Installation, NextMotion, Standing)  # loaded where a log needs them
ONLY_FOR_TYPES = {
    "pd": PANDAS,
    "Figure": matplotlib.figure.Figure,
    "Mapping": collections.abc.Mapping,
    **{each.__name__: each for each in OURS},
}
THE_USERS_OWN = {  # what a method gives that users write or override: theirs to say
    "begin": "a fault's state before its first sample",
    "distort": "broken samples, and a fault's state",
    "distort_sample": "a broken sample, and a fault's state",
    "learn": "what a detector learnt",
    "learned": "what a detector learnt",
    "scores": "arrays, lists or numbers, as numpy takes them",
    "function": "arrays, lists or numbers, as numpy takes them",
    "noise": "a number, a mapping or what numpy takes",
}


def is_any(hint):
    """Tell whether a type says nothing, or something within it."""
    if typing.get_origin(hint) is np.ndarray:  # its shape is Any by numpy's own alias
        return is_any(typing.get_args(hint)[1])
    if hint in (dict, list, tuple, set, frozenset):
        return True
    parts = hint if isinstance(hint, list | tuple) else typing.get_args(hint)
    return hint is typing.Any or (typing.get_origin(hint) is not typing.Literal and any(map(is_any, parts)))


def hints(of):
    return typing.get_type_hints(of, localns=ONLY_FOR_TYPES)


def gives(of):
    """Yield what a class or a function gives: a name, and the type of an attribute or of a result."""
    if not inspect.isclass(of):
        yield from ((of.__name__, hints(each)["return"]) for each in typing.get_overloads(of) or [of])
        return
    yield from ((name, hint) for name, hint in hints(of).items() if not name.startswith("_"))
    for name in dir(of):
        found = inspect.getattr_static(of, name)
        found = getattr(found, "fget", getattr(found, "__func__", found))
        found = found.func if isinstance(found, cached_property) else inspect.unwrap(found)
        if inspect.isfunction(found) and found.__module__.startswith("gtmbench") and not name.startswith("_"):
            yield from ((name, hint) for _, hint in gives(found))


def ours(hint):
    """Yield the project's own classes in a type."""
    if inspect.isclass(hint) and hint.__module__.startswith("gtmbench"):
        yield hint
    for part in hint if isinstance(hint, list | tuple) else typing.get_args(hint):
        yield from ours(part)


def test_nothing_public_gives_any():
    todo = [getattr(gb, name) for name in api.__all__] + [
        getattr(gb.testing, name) for name in gtmbench.testing.__all__
    ]
    todo = [of for of in map(inspect.unwrap, todo) if inspect.isclass(of) or inspect.isfunction(of)]
    seen, leaks, used = set(todo), [], set()
    while todo:
        of = todo.pop()
        for name, hint in gives(of):
            if is_any(hint):
                (used.add(name) if name in THE_USERS_OWN else leaks.append(f"{of.__qualname__}.{name}: {hint}"))
            fresh = set(ours(hint)) - seen
            seen |= fresh
            todo += fresh
    assert len(seen) > 250
    assert not leaks
    assert used == set(THE_USERS_OWN), "what is listed isn't needed any more"
