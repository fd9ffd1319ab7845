"""Policies on other machines: what is told to them, what they may answer, how they are reached."""
