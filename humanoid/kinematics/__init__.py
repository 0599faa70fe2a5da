"""A subject in configurations: placements, Jacobians, limits, proportions."""
