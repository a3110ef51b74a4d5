"""The explanations of what sensors of a course say, a file each."""
