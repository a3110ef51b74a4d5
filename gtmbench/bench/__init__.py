"""The bench: fly an aircraft, measure it, break a sensor."""
