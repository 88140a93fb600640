"""Two recordings, or two stored runs, side by side."""
