"""What a monitor and the engine say of a log, and the timeline that this comes to."""
