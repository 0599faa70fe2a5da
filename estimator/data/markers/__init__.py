"""Points in space over time that are given instead of pictures: a laboratory's markers, triangulated keypoints."""
