"""Subspace methods, one a file."""
