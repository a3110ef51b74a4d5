"""Banks of operators: alarms that are calibrated, and which sensor failed, how and since when."""
