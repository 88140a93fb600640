"""Rendered frames with truth, and the training of the CNN on them."""
