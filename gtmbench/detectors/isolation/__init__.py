"""Which sensor failed, and how: fault hypotheses, their fits, the diagnosis."""
