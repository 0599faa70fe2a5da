"""Proposals of single limbs by one instant alone: part detectors of the visual hull, of keypoints, and of
eigen-templates."""
