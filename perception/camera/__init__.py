"""Calibration of the lens and the mounting of a camera, self-calibration, image statistics."""
