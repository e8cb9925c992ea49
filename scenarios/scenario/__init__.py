"""Scenario files: reading and checking."""
