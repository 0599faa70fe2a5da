"""What is carried from frame to frame: modes, mixtures, paths."""
