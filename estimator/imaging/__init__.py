"""The pictures of a camera, and what is known of one instant: frame -> Observation."""
