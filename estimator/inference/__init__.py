"""Particles, annealing, walks, clusters; modes, mixtures of them and paths through them. Knows no image."""
