"""Benchmarks of readers on files of other projects: DBC files of cars, roads in OpenDRIVE."""
