"""Choosing orders, the number of excitations, and inputs: each from one triangle."""
