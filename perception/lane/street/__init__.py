"""Which lane of a street is that of the car: lines and kerbs across the road, and pairs of them."""
