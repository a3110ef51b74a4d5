"""gtmbench: fly an aircraft, break a sensor, and find out from the sensors alone.

>>> import gtmbench as gb
>>> flight = gb.fly(duration_s=5.0)
>>> record = gb.measure(flight, snr=50, seed=1)
>>> broken = gb.inject(record, gb.Jam(channel="p", onset_s=3.0))
>>> bool((broken["p"][300:] == broken["p"][299]).all())
True
"""

from typing import TYPE_CHECKING

from gtmbench.version import __version__ as __version__

if TYPE_CHECKING:
    from gtmbench.api import *  # noqa: F403
else:

    def __getattr__(name: str) -> object:
        """Import a public name when it is first asked for; until then, the package costs nothing.

        (Its pytest plugin is imported in every run of pytest where the package is installed.)
        """
        from importlib import import_module
        from importlib.util import find_spec

        api = import_module("gtmbench.api")
        if name not in api.__all__ and find_spec(f"gtmbench.{name}") is not None:
            return import_module(f"gtmbench.{name}")
        return getattr(api, name)

    def __dir__() -> list[str]:
        """Return the public names only."""
        return sorted(["__version__", *__getattr__("__all__")])
