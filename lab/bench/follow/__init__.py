"""Benchmarks of following a leader without a visible lane, and of the lead detector."""
