"""Measures that also make a shipped file from data.

| command | makes |
| --- | --- |
| `python -m benchmarks pose_prior --write` | `estimator/energy/pose_prior.json` |
| `python -m benchmarks limb_learning --write` | `estimator/trackers/loose_limbed/limbs/potentials.json` |
| `python -m benchmarks limb_likelihood --write` | `estimator/trackers/loose_limbed/limbs/gibbs.json` |
| `python -m benchmarks calibration --fit` | the defaults of `Calibration` in `estimator/runs/calibration.py`, printed |
"""
