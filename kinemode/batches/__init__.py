"""Many clips in one go: the manifest that lists them, read whole and checked before anything runs."""
