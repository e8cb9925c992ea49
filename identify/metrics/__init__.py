"""Metrics: what an estimate is worth, on data and against the truth."""
