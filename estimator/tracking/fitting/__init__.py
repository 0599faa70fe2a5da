"""One person's proportions and flesh from the first frames of a clip (CSS section 5): `person.fit_person`.

person: the fit, stage after stage. settings, fit: what it is given and what comes out. lengths: the first stage, the
proportions from keypoints; flesh: the second, cross-sections from pictures, and the third, everything together.
body_energy, contour_points: the later stages' energy; shaped_body, shape_parameters: what varies; descent: how it is
brought down.
"""
