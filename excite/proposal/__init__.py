"""The design loop: parameters of a signal from what is known of a plant, each with its reason."""
