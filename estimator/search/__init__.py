"""From hypotheses to the modes of a frame: starts, proposals, kinematic jumps, and their searches in a worker pool."""
