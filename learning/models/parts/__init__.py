"""What the networks share: the view of an image, heads, memories, weights from files. Needs torch."""
