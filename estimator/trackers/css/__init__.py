"""Covariance scaled sampling (Sminchisescu and Triggs, IJRR 2003), and the same with dual-chain's features beside
it."""
