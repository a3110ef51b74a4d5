"""Hypothesis draws the same examples in every run."""

from hypothesis import settings

settings.register_profile("gtmbench", derandomize=True, deadline=None)
settings.load_profile("gtmbench")
