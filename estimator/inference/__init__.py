"""Particles, resampling, annealing, clusters: knows neither bodies nor images."""
