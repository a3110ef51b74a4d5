"""What can go wrong, in types of our own: each message says what was given, what it implies and what to do."""

from __future__ import annotations


class GtmbenchError(Exception):
    """The base of every error this package raises on purpose; the command line ends with exit code 2.

    Examples
    --------
    >>> import gtmbench as gb
    >>> try:
    ...     gb.fly("gtm", duration_s=-3.0)
    ... except gb.GtmbenchError as error:
    ...     print(type(error).__name__)
    InputError
    """


class InputError(GtmbenchError, ValueError):
    """A record, a log, a scenario or an argument can't be used as given.

    Examples
    --------
    >>> import gtmbench as gb
    >>> try:
    ...     gb.Record([[1.0, 2.0]], channels=["p"], sample_period_s=0.01)
    ... except gb.InputError as error:
    ...     print(error)
    values of shape (1, 2) don't fit 1 channels; give (samples, 1)
    """


class TrimError(GtmbenchError):
    """No steady flight exists, or was found, at the requested condition.

    Examples
    --------
    >>> import gtmbench as gb
    >>> try:
    ...     gb.trim("gtm", tas_kt=30.0)
    ... except gb.TrimError as error:
    ...     print(str(error).split(":")[0])
    no trim for 'gtm' at 8000 ft and 30 kt true airspeed
    """


class EnvelopeError(GtmbenchError):
    """The aircraft left the range in which its model is valid.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> push = gb.Excitation(surfaces={"elevator": np.full(101, 20.0)})  # deg, for a second
    >>> try:
    ...     gb.fly("gtm", push, duration_s=1.0)
    ... except gb.EnvelopeError as error:
    ...     print(str(error).split(":")[0])
    the excitation throws 'gtm' out of its envelope
    """


class ConvergenceWarning(UserWarning):
    """An iteration ended before it had settled.

    Examples
    --------
    >>> import warnings
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u, w = rng.standard_normal(500), np.cumsum(rng.standard_normal(500))
    >>> record = gb.Record(np.column_stack([u, u + w]), channels=["u", "y"], sample_period_s=0.01)
    >>> hasty = gb.PredictionError(noise_order=1, most_iterations=1)
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     operator = gb.identify(
    ...         record, inputs=["u"], outputs=["y"], causal_order=0, noncausal_order=0, estimator=hasty
    ...     )
    >>> told[0].category.__name__, operator.noise_model.converged
    ('ConvergenceWarning', False)
    """


class RankWarning(UserWarning):
    """The data don't determine the Markov parameters; the predictions may still be good.

    Examples
    --------
    >>> import warnings
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> twice = gb.Record(np.column_stack([u, 2.0 * u, u]), channels=["u", "v", "y"], sample_period_s=0.01)
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     operator = gb.identify(twice, inputs=["u", "v"], outputs=["y"], causal_order=0, noncausal_order=0)
    >>> told[0].category.__name__, operator.rank
    ('RankWarning', 1)
    """


class NoteWarning(UserWarning):
    """Something should be known that stops nothing: a kept file carries no digest, a damaged part is made anew.

    Examples
    --------
    >>> import json, tempfile, warnings
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(2000)
    >>> record = gb.Record(np.column_stack([u, np.roll(u, 9)]), channels=["p", "r"], sample_period_s=0.01)
    >>> recipe = gb.DissertationOperator(inputs=("p",), causal_order=2, noncausal_order=2, window=100)
    >>> with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     path = Path(folder, "old.json")
    ...     gb.save_monitor(recipe.calibrate([record, record]), path)
    ...     document = json.loads(path.read_text())
    ...     old = {key: value for key, value in document.items() if key != "digest"}
    ...     _ = path.write_text(json.dumps(old | {"version": 2}))
    ...     monitor = gb.load_monitor(path)
    >>> told[0].category.__name__
    'NoteWarning'
    """
