"""What all rooms use: errors, the console, cores, options, steps and rates, and files on disk."""
