"""The kinds of explanations, a file each."""
