"""Recorded footage as a simulator: real images, reprojected to the pose of a simulated vehicle."""
