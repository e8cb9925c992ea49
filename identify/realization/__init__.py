"""Realization methods: models from impulse responses, free decays, steps and covariances."""
