"""One search for what explains the errors of a flight's readings: relations, explanations, findings."""
