"""Recorded footage as a simulator: real pixels, seen from beside where they were taken."""
