"""The numerical ground that the methods share."""
