"""Hypothesis draws the same examples in every run, and rerun asks the network nothing."""

import os

from hypothesis import settings

os.environ.setdefault("CI", "1")

settings.register_profile("gtmbench", derandomize=True, deadline=None)
settings.load_profile("gtmbench")
