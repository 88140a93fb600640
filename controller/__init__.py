"""Decision and vehicle state to command: steering laws, speed control, limiter, identification of the vehicle."""
