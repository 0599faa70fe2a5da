"""A batch of clips as people look at it: one table that says which clips to look at, a thumbnail a clip."""
