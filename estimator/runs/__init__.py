"""Results of tracking: run files, the posterior and its calibration, metrics, gait, and exports."""
