"""What a cue is, and points of the body with image features assigned to them; a folder a cue."""
