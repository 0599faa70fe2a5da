"""What pictures say of the body: visibility of its surface, assignments of image features to it, their terms."""
