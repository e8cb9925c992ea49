"""Subspace methods, one per file."""
