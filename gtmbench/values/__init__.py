"""Values: a record and what it is made of - channels, a clock, pieces -, and the estimator of an attitude."""
