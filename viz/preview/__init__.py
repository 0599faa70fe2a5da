"""The page in the browser: bodies, hypotheses, cameras, the video behind."""
