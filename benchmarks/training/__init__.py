"""Measures that also make a shipped file from data.

| command | makes |
| --- | --- |
| `python -m benchmarks rest_positions --write` | stabilisers of knees, arms and neck in `humanoid/urdf/human34.urdf` |
| `python -m benchmarks keypoint_places --write` | `humanoid/subject/layout_places/mediapipe33.toml` |
| `python -m benchmarks pose_prior --write` | `estimator/energy/pose_prior.json` |
| `python -m benchmarks limb_learning --write` | `estimator/trackers/loose_limbed/limbs/potentials.json` |
| `python -m benchmarks limb_likelihood --write` | `estimator/trackers/loose_limbed/limbs/gibbs.json` |
| `python -m benchmarks calibration --fit` | the defaults of `Calibration` in `estimator/runs/posterior.py`, printed |
"""
