"""The scene above the ground: vehicles, backdrop, tunnel, night, weather."""
