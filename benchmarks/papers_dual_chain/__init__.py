"""Reproduction of the dual-chain tracker: clips of an upper body, chains, blobs, arms by inverse kinematics."""
