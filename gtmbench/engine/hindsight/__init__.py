"""What gyros and attitude say of each other over a whole log: no part of it is taken for healthy."""
