"""Actuators: the output of the limiter on a wire, and what the car measures."""
