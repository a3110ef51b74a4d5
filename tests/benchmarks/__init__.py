"""Measured ratios: ``make bench``. One process, one thread, repetitions interleaved, medians."""
