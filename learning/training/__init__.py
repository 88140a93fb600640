"""Training of driving networks on recorded drives: ``trepid train``."""
