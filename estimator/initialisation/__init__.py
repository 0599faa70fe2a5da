"""The person's own body from the first frames with pictures: flesh after proportions (CSS section 5)."""
