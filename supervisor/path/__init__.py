"""The path to drive: fusion of estimates, following a vehicle, hand-over between the two."""
