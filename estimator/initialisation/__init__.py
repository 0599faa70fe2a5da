"""The person's own body from the first frames with pictures: shape after proportions (CSS section 5, stages two and three)."""
