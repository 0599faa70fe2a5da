"""Bottom-up proposals of limbs: where each may be, by one instant alone ("shouters", Sigal et al. 2004)."""
