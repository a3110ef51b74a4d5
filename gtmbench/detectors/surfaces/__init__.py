"""Surfaces: whether the aircraft answers its commands as it did when it was healthy, and which surface doesn't."""
