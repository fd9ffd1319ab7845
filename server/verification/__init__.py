"""`hide verify`: what was measured is recomputed from what was recorded, and nothing is believed.

Scores follow from verdicts, verdicts from decisions, decisions from actions that are played again;
files from their hashes. Everything is read, nothing written.
"""
