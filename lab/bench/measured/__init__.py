"""Wrong measurements of the car through every wire: the lane, and the name of the quantity."""
