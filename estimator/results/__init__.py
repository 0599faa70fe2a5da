"""What came of a track: run files, the posterior and its calibration, evaluation, exports."""
