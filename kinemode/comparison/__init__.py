"""Several trackers on one clip: their runs, scores, table and plot."""
