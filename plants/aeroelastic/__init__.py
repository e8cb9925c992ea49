"""Aeroelastic aircraft and wings: elastic modes in an air stream, moved by control surfaces and turbulence."""
