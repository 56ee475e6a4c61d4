"""`python -m benchmarks`, from the checkout."""

from benchmarks.performance.run import main

if __name__ == "__main__":
    main()
