"""The image likelihood of single limbs: what a cone's edges, axis and inside look like where there is a limb."""
