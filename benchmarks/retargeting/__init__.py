"""Motions of persons on robots: ours, a peer's, and inverse kinematics frame by frame, by the same figures."""
