"""Order selection."""
