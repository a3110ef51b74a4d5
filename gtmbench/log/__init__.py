"""A recorded flight, watched: opened for a detector, parted into healthy and watched, and what was found."""
