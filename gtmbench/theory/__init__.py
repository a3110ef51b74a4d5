"""The dissertation away from aircraft: exact operators, Laurent series, loops, structures, realisations.

Every module stands for itself; `experiments/` puts them beside the printed results.
"""
