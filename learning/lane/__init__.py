"""Training of the lane network."""
