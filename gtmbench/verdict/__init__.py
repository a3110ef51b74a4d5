"""What a log's verdict is: a timeline for every sensor, what is asked of it, and what that comes to."""
