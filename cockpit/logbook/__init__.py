"""Explanations of a recorded drive."""
