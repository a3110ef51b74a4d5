"""Banks of operators: what they are, how healthy records calibrate them, which faults they can tell."""
