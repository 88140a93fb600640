"""Simulated cars behind a real wire: each process speaks the wire of one kind of actuator and contains the car."""
