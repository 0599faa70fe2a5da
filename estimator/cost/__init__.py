"""Robust potentials and energy terms, each with value, gradient and Hessian in the tangent space."""
