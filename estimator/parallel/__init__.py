"""Several processes and the memory that they share; knows nothing of what they work on."""
