"""Kinds of faults: what each makes of a signal, for injecting it and for diagnosing it."""
