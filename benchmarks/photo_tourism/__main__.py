"""`python -m benchmarks.photo_tourism`, from the checkout."""

import sys

from benchmarks.photo_tourism.study import main

if __name__ == "__main__":
    sys.exit(main())
