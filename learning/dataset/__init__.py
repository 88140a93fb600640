"""Recorded drives -> data sets: an index of frames with their road-wheel angles; the images stay where they are."""
