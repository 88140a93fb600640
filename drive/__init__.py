"""The drive of a car: which processes run, their start, their losses, the stop at the end, and the result."""
