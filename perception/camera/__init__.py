"""Calibration of the camera, its mounting, and image statistics."""
