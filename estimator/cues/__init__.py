"""What a cue is; the rooms below are one cue each, brought together by `estimator.likelihood`."""
