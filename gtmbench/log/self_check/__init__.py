"""The self-check: is a log what a monitor expects, and if not, why? Before anything is said of its sensors."""
