"""Drives for Foxglove and Lichtblick: what these viewers draw, derived from the messages; files and live."""
