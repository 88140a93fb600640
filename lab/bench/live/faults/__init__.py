"""Faults of a live drive: real processes, harmed on the simulated car and through the CAN counterpart."""
