"""The person's surface in space, by stereo or a depth camera."""
