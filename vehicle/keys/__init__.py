"""Keys: an authority for one car, and a certificate for each of its processes."""
