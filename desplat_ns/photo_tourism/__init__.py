"""Photos by many people at many times: light that changes, skies, and who stood in the way."""
