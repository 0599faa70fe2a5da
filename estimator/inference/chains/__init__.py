"""Several chains of one scene combined through the image features that they all predict: neither bodies nor images."""
