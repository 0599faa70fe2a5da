"""Walking: when the feet touch and leave the ground, and what the strides between are like."""
