"""Signed distances between the parts of a body, witness points, gradients."""
