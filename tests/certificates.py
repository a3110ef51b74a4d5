"""Certificates that are worked out when they are read: few tests of logs do, and they take most of a log's time."""

from dataclasses import fields
from functools import cached_property
from operator import attrgetter

from gtmbench.faults.kinds import Bias
from gtmbench.study.log import certificate
from gtmbench.study.log.certificate import KINDS, Certificate, certificate_of, hardly_watched


class WhenRead(Certificate):
    """A certificate that nobody knows before one of its fields is read; then it is as `certificate_of` has it."""

    def __init__(self, monitor, watches, **how):
        vars(self).update(asked=(monitor, watches), how=how)

    @cached_property
    def whole(self):
        """Return it all."""
        return certificate_of(*self.asked, **self.how)

    @cached_property
    def of_biases(self):
        """Return its rows of biases, which are worked out for themselves: a fifth of the work."""
        if "whole" in vars(self):
            return self.whole
        kinds, certificate.KINDS = certificate.KINDS, tuple(kind for kind in KINDS if kind.fault is Bias)
        try:
            return certificate_of(*self.asked)
        finally:
            certificate.KINDS = kinds

    def __reduce__(self):
        """Go to another process as the certificate that it is."""
        return self.whole.__reduce__()


for field in fields(Certificate):
    setattr(WhenRead, field.name, property(attrgetter(f"whole.{field.name}")))


def worked_out_when_read(monitor, watches, **how):
    """Stand in for `certificate_of`."""
    return WhenRead(monitor, watches, **how)


def hardly_watched_by_biases(said, watches):
    """Stand in for `hardly_watched`, which reads the rows of biases only."""
    return hardly_watched(said.of_biases if isinstance(said, WhenRead) else said, watches)
