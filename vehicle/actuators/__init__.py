"""Actuators: the output of the limiter on a wire, and the measured state of the car."""
