"""Longitudinal control: speed limits of the lane, acceleration demand."""
