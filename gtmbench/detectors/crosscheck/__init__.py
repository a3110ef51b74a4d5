"""The cross-check: what magnetometer, GPS, accelerometers, air data and altitude say of each other."""
