"""Rules give the same result in every process."""

from lab.bench.fear.determinism import differing_processes


def test_processes_with_other_hash_seeds_compute_the_same_bits() -> None:
    assert differing_processes(5, processes=1) == 0
