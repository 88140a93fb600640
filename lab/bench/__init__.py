"""`trepid bench`: benchmarks, each with a peer in the same run."""
