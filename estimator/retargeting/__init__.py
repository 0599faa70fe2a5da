"""A motion of one body on another: within limits, feet on the ground."""
