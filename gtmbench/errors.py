"""What can go wrong, in types of our own: each message says what was given, what it implies and what to do."""

from __future__ import annotations


class GtmbenchError(Exception):
    """The base of every error this package raises on purpose; the command line ends with exit code 2."""


class InputError(GtmbenchError, ValueError):
    """A record, a log, a scenario or an argument can't be used as it was given."""


class TrimError(GtmbenchError):
    """No steady flight exists, or was found, at the wanted condition."""


class EnvelopeError(GtmbenchError):
    """The aircraft left the range in which its model means anything."""


class ConvergenceWarning(UserWarning):
    """An iteration ended before it had settled."""


class RankWarning(UserWarning):
    """The data don't determine the Markov parameters; the predictions may be good all the same."""
