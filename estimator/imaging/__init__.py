"""Camera, clip and cues: frame -> Observation."""
