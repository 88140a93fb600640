"""From pixels to a fitted lane: points of lines, road surface and edges, vote, search."""
