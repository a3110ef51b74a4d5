"""A loop that flies on without a sensor that failed: who is doubted, what stands in, and what decides."""
