"""Particles, annealing, walks, clusters; modes, mixtures of them and paths through them. Independent of images."""
