"""Messages to named numbers: age, plausibility, features."""
