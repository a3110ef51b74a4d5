"""Estimators: a problem in, an estimate out. A new one is a frozen dataclass with `instruments` and `estimate`."""
