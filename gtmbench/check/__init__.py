"""The check: figures of a run held against those of a baseline, for a CI to fail on."""
