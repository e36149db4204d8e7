"""Measuring scripts: each prints a table and takes --json FILE. They use the public tracker only.

One thread per process: linear algebra on matrices this small only loses by more. It must be said before numpy is
imported, and this file is imported first.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"
