"""Figures as PNG: of studies, logs and choices."""
