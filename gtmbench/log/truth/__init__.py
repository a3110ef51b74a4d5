"""A log's own truth: failures that it says were injected, and what its autopilot said."""
