"""How the simulated vehicle moves."""
