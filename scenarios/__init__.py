"""Scenario files and everything that runs them."""
