"""Recorded flights: their logs as flown, broken and misread, and what is said of each."""
