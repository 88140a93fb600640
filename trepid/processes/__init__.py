"""Processes of a drive: start, monitoring and stop; the loop of every process."""
