"""Cars and recordings from Python, for notebooks."""
