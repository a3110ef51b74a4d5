"""The kinds of faults: a class each, with all that is said of it, in three files or in one of its own."""
