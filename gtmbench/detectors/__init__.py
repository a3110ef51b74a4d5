"""Detectors: recipes that healthy records calibrate into monitors, and what a monitor says of a record."""
