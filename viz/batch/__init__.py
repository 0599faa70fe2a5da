"""Overview of a batch of clips: one table and one page with the clips to review first, and a thumbnail for each
clip."""
