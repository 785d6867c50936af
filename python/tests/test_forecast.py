"""Forecasts from stage times."""

import json

import pytest

from linecarve import forecast


def write(path, *, tiles, points, per_point, per_other=0.0, merge=1e-6):
    """Stage times of a run whose tiles are all alike."""
    own = points / tiles
    frame = own * (per_point + per_other * (tiles - 1))

    def item(stage, number, seconds):
        manifest = {"seconds": seconds, "counts": [["vertices", int(own)]], "peak_mb": 1.0}
        return {"stage": stage, "item": number, "done": True, "manifest": manifest}

    items = [item("frame", number, frame) for number in range(tiles)]
    path.write_text(json.dumps({"items": [*items, item("merge", 0, merge * points)]}))
    return forecast.read(path)


def test_stages_wait_for_each_other_and_tasks_for_workers(tmp_path):
    run = write(tmp_path / "run.json", tiles=4, points=4000, per_point=1e-2)
    def wall(workers):
        return forecast.forecast([run], points=4000, tiles=4, workers=workers, start=0.0).wall

    merge = 4000 * 1e-6
    assert wall(1) == pytest.approx(40 + merge)
    assert wall(2) == pytest.approx(20 + merge)
    assert wall(3) == pytest.approx(20 + merge)
    assert wall(100) == pytest.approx(10 + merge)
    larger = forecast.forecast([run], points=8000, tiles=8, workers=8, start=0.0)
    assert larger.wall == pytest.approx(10 + 2 * merge) and larger.busy == pytest.approx(80 + 2 * merge)


def test_two_runs_tell_how_tasks_grow_with_other_tiles(tmp_path):
    runs = [
        write(tmp_path / f"{tiles}.json", tiles=tiles, points=1000 * tiles, per_point=1e-2, per_other=1e-4)
        for tiles in (5, 50)
    ]
    result = forecast.forecast(runs, points=1e6, tiles=1000, workers=1000, start=0.0)
    assert result.stages["frame"] == pytest.approx(1000 * (1e-2 + 999 * 1e-4))


def test_what_is_not_done_is_named(tmp_path):
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"items": [{"stage": "carve", "item": 3, "done": False, "manifest": None}]}))
    with pytest.raises(ValueError, match="carve 3 is not done"):
        forecast.read(path)
    with pytest.raises(SystemExit):
        forecast.main([str(path)])
