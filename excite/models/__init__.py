"""Models: what an estimate or a truth is, and what it can do."""
