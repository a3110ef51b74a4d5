"""An airframe's history: the constants of its flights, what a new flight's are beside them, and what to fly next."""
