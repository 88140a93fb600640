"""What touches a real car: cameras, actuators, driver input, keys."""
