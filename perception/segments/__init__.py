"""Lanes from the masks of a segmentation network: lane lines, drivable area."""
