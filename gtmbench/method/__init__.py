"""The method: records in, values out. It never sees the simulator, the surface commands or the truth."""
