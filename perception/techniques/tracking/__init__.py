"""Stages that track boundaries from frame to frame: Kalman filters, particles, a grid."""
