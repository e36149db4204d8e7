"""Entry point of `python -m lassokin_ros.demo`, which `make demo` runs."""

import sys

from lassokin_ros.demo.demo import main

if __name__ == "__main__":
    sys.exit(main())
