"""From a recorded flight's file, as it comes, to clean segments and remarks on what was wrong with it."""
