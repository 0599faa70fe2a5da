"""Visualisation: the browser preview, the image overlay and the contact sheet of a run."""
