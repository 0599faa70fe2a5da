"""What a camera should see of a pose: visible nodes and occluding contours."""
