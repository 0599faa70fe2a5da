"""A batch of clips as people look at it: one table and one page that say which clips to look at, a thumbnail a clip."""
