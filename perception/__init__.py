"""Camera frame in, lane estimate out. Imports nothing of the project but ``trepid``."""
