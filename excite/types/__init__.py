"""The types that travel between the rooms: frozen, validated once, time on axis 0, always 2-D."""
