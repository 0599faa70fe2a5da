"""Clicking landmarks in the browser."""
