"""How often the survey is right: generated scenes whose truth is known, and the real ones."""
