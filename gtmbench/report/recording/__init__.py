"""Recordings for the rerun viewer: written, read back, compared, laid over each other."""
