"""Driver input: a game pad or keyboard drives by hand, permits driving, takes over, stops and marks recordings."""
