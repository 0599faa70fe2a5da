"""Overview of a batch of clips: one table and one page with the clips to look at first, and a thumbnail for each
clip."""
