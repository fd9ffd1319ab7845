"""Keyframe verbs, by what they are done to."""
