"""Benchmarks: each script prints a table and takes --json FILE. They use the public tracker only.

Each process uses one thread, because linear algebra on small matrices is slower with more. The variables must be set
before numpy is imported; this file is imported first.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"
