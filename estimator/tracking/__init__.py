"""From observations to results: trackers by name with all their settings, and the runner."""
