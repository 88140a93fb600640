"""Training of the lead detector."""
