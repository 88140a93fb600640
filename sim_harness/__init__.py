"""The harness: roads, renderer, plant, scenarios and metrics. Command in, vehicle state and frames out."""
