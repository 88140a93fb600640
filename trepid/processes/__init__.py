"""Processes of a drive: start, watch, stop; what every process shares."""
