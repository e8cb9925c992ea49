"""What the hardware allows: limits, their checks, and the shaping of signals to them."""
