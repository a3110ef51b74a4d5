"""A calibrated monitor as a folder of C, for a flight controller."""
