"""A body as limbs: which bodies make one, their frames, their cones, and which limb hangs on which."""
