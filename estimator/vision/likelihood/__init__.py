"""The image likelihood: all cues, read from the pictures and matched to a pose."""
