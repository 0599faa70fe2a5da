"""One camera's pictures: features (edges, ridges, skin, stereo depth), and what it should see of a pose (`prediction`,
`visibility`)."""
