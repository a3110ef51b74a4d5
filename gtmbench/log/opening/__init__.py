"""What is asked of a log, and the log as it is opened: its records, whose attitude it is, whether it has a heading."""
