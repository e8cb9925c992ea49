"""Heat flow: sources, their thermal networks, and the temperatures seen."""
