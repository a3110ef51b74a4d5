"""Further IMUs of a flight: how each is mounted, and what its gyros and those that are watched say of each other."""
