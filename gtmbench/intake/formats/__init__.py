"""A reader for each format of logs: columns as they are named, each with its own stamps."""
