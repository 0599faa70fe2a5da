"""Numbers alone: robust potentials, rigid alignment, linear systems, rotations, distances between points, damped Newton
steps, quadratic programs. Independent of bodies and images."""
