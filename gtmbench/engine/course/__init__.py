"""Air data, accelerometers, GPS, altitude and magnetometers: the course of a flight, and who failed that reads it."""
