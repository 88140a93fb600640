"""Conditions on a run: the language of `expect`."""
