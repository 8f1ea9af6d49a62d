"""A run that is killed, whenever, goes on to the same bytes as one that is not."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from algorithms.registry import get_method
from bench.spec import RunSpec
from tests.bench.killing import Killing, differences, leftovers

Make = Callable[..., RunSpec]
KILLS = 20
SAC_STEPS = 4_000
"""A second or two of training, in ten parts."""


def test_a_kill_in_the_middle_of_sac_leaves_no_trace_in_its_record(tmp_path: Path, make_spec: Make) -> None:
    version = get_method("sac").version
    killing = Killing(make_spec(method="sac", method_version=version, steps=2_400, eval_episodes=8), every_steps=400)
    whole, seconds = killing.whole(tmp_path / "whole")
    records = killing.killed(tmp_path / "killed", 2, seconds, seed=3)
    assert all(differences(record, whole) == [] for record in records)
    assert all(leftovers(record) == [] for record in records)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "steps", "every"),
    [("sac", SAC_STEPS, 400), ("dd-rq", SAC_STEPS, 400), ("dd-rq:rq=shuffled", SAC_STEPS, 400)],
)
def test_twenty_kills_at_random_moments_leave_no_trace_in_the_records(
    tmp_path: Path, make_spec: Make, method: str, steps: int, every: int
) -> None:
    def share_artefacts(results: Path) -> None:
        if (tmp_path / "whole" / "cache").exists() and not (results / "cache").exists():
            shutil.copytree(tmp_path / "whole" / "cache", results / "cache")

    spec = make_spec(method=method, method_version=get_method(method).version, steps=steps, eval_episodes=8)
    killing = Killing(spec, every, share_artefacts)
    whole, seconds = killing.whole(tmp_path / "whole")
    records = killing.killed(tmp_path / "killed", KILLS, seconds, seed=1)
    assert all(differences(record, whole) == [] for record in records)
    assert all(leftovers(record) == [] for record in records)
    assert any(record.details["resumes"] for record in records), "no kill fell between two checkpoints"
