"""Recordings of drives: MCAP files, written and read."""
