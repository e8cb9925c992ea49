"""Numerics that all rooms share: exact simulation, block-Hankel factors, correlations, networks."""
