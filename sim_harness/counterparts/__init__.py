"""Simulated cars behind a real wire: each process implements the protocol of one actuator and contains the car."""
