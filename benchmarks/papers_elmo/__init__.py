"""Reproduction of ELMO: stereo sequences, single frames, occlusions, and its index of examples."""
