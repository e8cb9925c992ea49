"""The numerical steps that the methods share."""
