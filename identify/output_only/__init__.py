"""Output-only identification: stochastic subspace methods, for structures that the environment excites."""
