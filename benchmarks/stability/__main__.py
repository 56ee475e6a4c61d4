"""`python -m benchmarks.stability`, from the checkout."""

from benchmarks.stability.report import main

if __name__ == "__main__":
    main()
