"""The constrained step, mode seeking, hard clearance, covariance at a mode."""
