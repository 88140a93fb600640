"""Scores of a run, from its trace."""
