"""The study: where bench and method meet. Scenarios are flown, broken, watched and scored."""
