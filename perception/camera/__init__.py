"""What images tell of their camera: self-calibration, optics, odometry; image statistics."""
