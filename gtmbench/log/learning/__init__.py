"""What of a log is healthy, and the monitor that is learnt from it."""
