"""The suite as a benchmark: scenarios by tag, tracks by car."""

import pytest

from lab.bench import runs


def test_the_tracks_of_the_small_cars_count_beside_the_scenarios(monkeypatch: pytest.MonkeyPatch) -> None:
    def row(name: str) -> runs.Row:
        scores = dict(departures=0, interventions=0, collisions=0, distance_m=500.0, max_lateral_error_m=0.1)
        return {"scenario": name, "status": "failed" if name == "carpet" else "passed", **scores}

    def answer(*words: str) -> list[runs.Row]:
        if words[:2] == ("sim", "list"):
            return [{"name": "straight", "tags": ["nominal"]}, {"name": "fog", "tags": ["weather"]}]
        return (
            [row(name) for name in ("straight", "fog")] if "all" in words else list(map(row, tracks(words)))
        )

    def tracks(words: tuple[str, ...]) -> tuple[str, ...]:
        return words[2 : words.index("--car")]

    monkeypatch.setattr(runs, "trepid", answer)
    measured = runs.bench_suite(1)
    assert {tag: of["runs"] for tag, of in measured["scenarios"].items()} == {
        "all": 2,
        "nominal": 1,
        "weather": 1,
    }
    assert measured["tracks"]["mini"]["runs"] == 10
    assert measured["tracks"]["rc-car"]["passed"] == measured["tracks"]["rc-car"]["runs"] - 1
    assert measured["tracks"]["mini"]["distance [km]"] == 5.0
    assert measured["failed"] == ["carpet"]
