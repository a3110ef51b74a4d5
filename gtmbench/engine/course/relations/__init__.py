"""The relations between sensors of a course, a file each."""
