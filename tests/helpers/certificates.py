"""Certificates that are worked out when they are read, at few onsets: they take most of the time of watching a log.

Tests that hold a certificate's figures call `certificate_of`, or use the fixture `whole_certificates`.
"""

from contextlib import contextmanager
from dataclasses import fields
from functools import cached_property
from operator import attrgetter
from unittest.mock import patch

from gtmbench.faults.kinds import Bias
from gtmbench.study.log import certificate
from gtmbench.study.log.certificate import KINDS, Certificate, certificate_of, hardly_watched

FEW = 5  # onsets, of 20


@contextmanager
def at_few_onsets(**more):
    """Let certificates be worked out at few onsets."""
    with patch.multiple(certificate, _ONSETS=FEW, **more):
        yield


class WhenRead(Certificate):
    """A certificate that nobody knows before one of its fields is read."""

    def __init__(self, monitor, watches, **how):
        vars(self).update(asked=(monitor, watches), how=how)

    @cached_property
    def whole(self):
        """Return it all."""
        with at_few_onsets():
            return certificate_of(*self.asked, **self.how)

    @cached_property
    def of_biases(self):
        """Return its rows of biases, which are worked out for themselves: a fifth of the work."""
        if "whole" in vars(self):
            return self.whole
        with at_few_onsets(KINDS=tuple(kind for kind in KINDS if kind.fault is Bias)):
            return certificate_of(*self.asked, means=self.how.get("means"))

    def __reduce__(self):
        """Go to another process as the certificate that it is."""
        return self.whole.__reduce__()


for field in fields(Certificate):
    setattr(WhenRead, field.name, property(attrgetter(f"whole.{field.name}")))


def hardly_watched_by_biases(said, watches):
    """Stand in for `hardly_watched`, which reads the rows of biases only."""
    return hardly_watched(said.of_biases if isinstance(said, WhenRead) else said, watches)
