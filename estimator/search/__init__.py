"""Constrained steps, mode seeking and proposals."""
