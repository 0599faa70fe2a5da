"""One person's proportions and flesh from pieces of a clip (CSS section 5): `person.fit_person`.

person: the fit, stage after stage. settings, fit: what it is given and what comes out. frames: which pieces of the
clip are used. lengths: the first stage, the proportions from keypoints; markers: the same from points in space;
measures: the energy of both, lengths and the places of points on the body; fitted_points: keypoints and markers as such
points; keypoint_noise: how far keypoints are from the fitted body. flesh: the second stage, cross-sections from
pictures, and the third, everything together. body_energy, contour_points: the later stages' energy; shaped_body,
shape_parameters: what varies; descent: how it is brought down.
"""
