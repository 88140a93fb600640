"""Recordings played again: onto the bus, or through the nodes that were recorded."""
