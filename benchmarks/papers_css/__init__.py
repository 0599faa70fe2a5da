"""Reproduction of covariance scaled sampling (CSS): Table 1, the failures of section 6, what each part is worth."""
