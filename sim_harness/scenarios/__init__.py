"""Scenarios: roads, traffic, faults and disturbances of a run, and its expectations."""
