"""A calibrated bank at work: scores, alarms and their judgements, on a record or as samples come in."""
