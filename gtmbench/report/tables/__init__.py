"""Results as plain data: JSON and CSV."""
