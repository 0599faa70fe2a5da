"""What came of a track: run files, the posterior and its calibration, metrics, gait, and exports."""
