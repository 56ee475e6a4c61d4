"""Photos of changing light: appearance and background models, embeddings."""
