"""The vehicle ahead: detection, tracking and the choice of the leader."""
