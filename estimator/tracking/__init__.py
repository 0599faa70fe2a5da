"""From observations to results: trackers by name with their settings, and the runner."""
