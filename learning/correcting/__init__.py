"""Correction of a driving network: drive alone in the simulator, label where it drifts, train again."""
