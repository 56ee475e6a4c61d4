"""`python -m lab.stability`, from the checkout."""

from lab.stability.report import main

if __name__ == "__main__":
    main()
