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
        """Import everything public with the first name that is asked for; until then, the package costs nothing.

        (Its pytest plugin is imported in every run of pytest where the package is installed.)
        """
        from importlib import import_module

        if "__all__" not in globals():
            api = import_module("gtmbench.api")
            globals().update({public: getattr(api, public) for public in (*api.__all__, "__all__")})
        if name not in globals():
            raise AttributeError(f"module 'gtmbench' has no attribute '{name}'")
        return globals()[name]

    def __dir__() -> list[str]:
        """Return the public names only."""
        return sorted(["__version__", *__getattr__("__all__")])
