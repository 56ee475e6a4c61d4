"""`python -m lab.performance`, from the checkout."""

from lab.performance.run import main

if __name__ == "__main__":
    main()
