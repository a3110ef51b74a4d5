"""A link to something that flies: messages as they arrive, watched by a monitor, told event by event."""
