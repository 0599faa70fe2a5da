"""Numbers alone: robust potentials, rigid alignment, linear systems, rotations, distances between points, and a pool of
worker processes with the memory they share. Knows neither body nor image."""
