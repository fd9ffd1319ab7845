"""Settings that hold for every test."""

from hypothesis import settings

# Compiling a kernel or sharing two cores must not fail a law, and a red run must stay red.
settings.register_profile("hide", deadline=None, derandomize=True)
settings.load_profile("hide")
