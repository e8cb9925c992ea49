"""Prediction-error methods, one a file."""
