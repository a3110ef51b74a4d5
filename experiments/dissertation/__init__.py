"""What the scripts of `experiments/` share: ours beside the print, and their figures."""
