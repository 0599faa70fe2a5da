"""One person's proportions and flesh from the first frames of a clip."""
