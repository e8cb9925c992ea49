"""Linear plants: matrices, loops, actuators, and the examples of textbooks."""
