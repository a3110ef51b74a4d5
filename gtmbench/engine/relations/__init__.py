"""The relations between gyros, attitude and accelerometers, a file each."""
