"""From the cues of an image to energy terms around a pose."""
