"""The simulated world: roads, OpenDRIVE files, rendering, vehicle models."""
