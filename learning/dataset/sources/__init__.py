"""Readers of recorded drives, one module a format."""
