"""The energy of a frame, assembled from its terms."""
