"""How far the camera sees along the lane, and what ends its sight."""
