"""The dissertation away from aircraft: exact operators, Laurent series, loops, structures, realisations.

Every module stands for itself; the scripts of `experiments/` put them beside the printed results.
"""
