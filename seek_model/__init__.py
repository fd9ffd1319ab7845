"""SEEK, its baselines and their training; everything in the project that needs torch."""
