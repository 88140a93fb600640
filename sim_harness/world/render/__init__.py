"""What the camera sees: ground, road surface, sky, vehicles, light and lens."""
