"""The project's measures by name: `python -m benchmarks --list`, `python -m benchmarks NAME --help`.

They run from a checkout with `pip install -e .[benchmark]`. Times are taken on one core: the matrices are small, and
linear algebra that spreads them over all cores only gets slower and less steady.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
