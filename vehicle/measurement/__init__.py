"""Measurements of the car that hold: range, physics, and agreement of speed, wheel angle, yaw rate and commands."""
