"""Prediction-error methods, one per file."""
