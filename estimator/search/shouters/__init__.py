"""Bottom-up proposals of limbs: where each may be, by what is seen of one instant alone ("shouters", Sigal et al. 2004)."""
