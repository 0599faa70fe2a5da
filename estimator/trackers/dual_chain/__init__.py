"""Dual chain: several chains of one image combined through the features that they share."""
