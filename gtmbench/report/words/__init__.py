"""Results in words: units, judgements, studies, logs, monitors."""
