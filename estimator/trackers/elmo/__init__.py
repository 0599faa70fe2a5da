"""ELMO (Demirdjian et al., ICCV 2005): modes of a frame searched from examples that look like its pictures."""
