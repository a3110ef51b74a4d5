"""Faults put into a recorded flight, and into the attitude that follows its gyros."""
