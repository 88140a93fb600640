"""Parts that this package adds to Trepid: one of each kind."""
