"""Belief propagation with mixtures of kernels on any graph (PAMPAS, Isard 2003): knows neither bodies nor images."""
