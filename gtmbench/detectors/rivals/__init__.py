"""Rivals: detectors of the literature, each in a file with its source, all judged by one rule."""
