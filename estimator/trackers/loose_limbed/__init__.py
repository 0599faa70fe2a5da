"""Loose-limbed people (Sigal et al., CVPR 2004): beliefs of single limbs by messages along a graph, and poses assembled
from them."""
