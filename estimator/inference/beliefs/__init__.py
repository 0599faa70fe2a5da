"""Belief propagation with mixtures of kernels on any graph (PAMPAS, Isard 2003): independent of bodies and images."""
