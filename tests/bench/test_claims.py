"""Claims: reproduced only with enough seeds and episodes, refuted by what contradicts them, else undecided."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench import claims, learning_curve
from bench.claims import Claim, Part, Verdict
from bench.claims.comparing import compared
from bench.claims.evidence import Evidence, return_after
from bench.claims.rules import least_told_from_zero
from bench.cli.commands import app
from bench.records import collect, read_record
from bench.statistics import Estimate, Interval, episodes_for_zero_claim

MakeRecord = Callable[..., Path]
FULL = {"steps": 500_000, "eval_episodes": 2_500, "trained": 900}
GUARDS = ("safety-guard:tc=1.0", "safety-guard", "safety-guard:tc=5.0", "safety-guard:tc=7.0")


def _judged(results: Path) -> dict[str, Claim]:
    return {claim.name: claim for claim in claims.judge(collect(results))}


def test_records_as_the_paper_describes_them_reproduce_every_claim(standard_results: Path) -> None:
    found = _judged(standard_results)
    assert {name: claim.verdict for name, claim in found.items()} == dict.fromkeys(
        ("C1", "C2", "C3", "C4", "C5"), Verdict.REPRODUCED
    )
    assert [len(claim.parts) for claim in found.values()] == [4, 8, 4, 10, 5]
    assert found["C2"].deciding.effect == pytest.approx(0.7, abs=1e-3)
    assert found["C3"].deciding.effect == pytest.approx(1 / 3, rel=0.05)
    assert found["C4"].deciding.effect == pytest.approx(0.4, abs=1e-6)
    assert found["C5"].deciding.effect > 0.0


def test_the_json_is_a_list_with_the_promised_keys(standard_results: Path, tmp_path: Path) -> None:
    found = claims.judge(collect(standard_results))
    written = json.loads(claims.write(tmp_path, found).read_text())
    assert [entry["claim"] for entry in written] == ["C1", "C2", "C3", "C4", "C5"]
    for entry in written:
        assert {"claim", "verdict", "effect", "interval", "n", "records"} <= set(entry)
        assert len(entry["interval"]) == 2
    first = written[0]
    assert first["effect"] == 0.0
    assert first["interval"][0] == 0.0
    assert 0.0 < first["interval"][1] < 0.0012, "a zero has its bound"
    assert first["n"] == 2 * 3 * (900 + 2_500)
    assert len(first["records"]) == 6
    assert all((standard_results / "runs" / name).is_dir() for name in first["records"])


def test_the_same_records_give_the_same_bytes(standard_results: Path, tmp_path: Path) -> None:
    for name in ("1", "2"):
        claims.write(tmp_path / name, claims.judge(collect(standard_results)))
    assert (tmp_path / "1" / "claims.json").read_bytes() == (tmp_path / "2" / "claims.json").read_bytes()


def test_one_collision_refutes_zero_even_with_a_single_seed(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="dd-rq", collisions=1, **FULL)
    claim = _judged(tmp_path)["C1"]
    assert claim.verdict is Verdict.NOT_REPRODUCED
    assert claim.reason == "dd-rq on a, A: 1 collisions in 2500 episodes"


def test_a_zero_without_enough_seeds_or_episodes_stays_undecided(tmp_path: Path, make_record: MakeRecord) -> None:
    for scenario in "ab":
        for seed in range(2):
            make_record(tmp_path, method="dd-rq", scenario=scenario, seed=seed, **FULL)
    claim = _judged(tmp_path)["C1"]
    assert claim.verdict is Verdict.UNDECIDED
    assert "dd-rq on a: 2 of at least 3 seeds" in claim.reason
    assert claim.deciding.interval.high == pytest.approx(1.0 - 0.05 ** (1 / 1_800)), "the bound is told all the same"
    for scenario in "ab":
        make_record(tmp_path, method="dd-rq", scenario=scenario, seed=2, **{**FULL, "trained": 600})
    claim = _judged(tmp_path)["C1"]
    assert claim.verdict is Verdict.UNDECIDED
    assert "dd-rq on a, T: 2,400 of at least 2,495 episodes" in claim.reason
    assert "dd-rq on a, A" not in claim.reason


def test_the_held_out_list_is_no_longer_for_being_driven_by_more_seeds(tmp_path: Path, make_record: MakeRecord) -> None:
    for scenario in "ab":
        for seed in range(3):
            make_record(tmp_path, method="dd-rq", scenario=scenario, seed=seed, **{**FULL, "eval_episodes": 2_000})
    claim = _judged(tmp_path)["C1"]
    assert claim.verdict is Verdict.UNDECIDED
    assert claim.reason == "; ".join(f"dd-rq on {s}, A: 2,000 of at least 2,495 distinct episodes" for s in "ab")


def test_a_zero_must_be_told_from_the_least_rate_that_the_paper_prints(standard_results: Path) -> None:
    least = least_told_from_zero(Evidence(collect(standard_results)))
    assert least == pytest.approx(0.0012)
    assert episodes_for_zero_claim(least) == 2_495


def test_the_command_prints_the_list_and_writes_it(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="idm", steps=0)
    result = CliRunner().invoke(app, ["claims", "--json", "--results", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output) == json.loads((tmp_path / "claims.json").read_text())
    text = CliRunner().invoke(app, ["claims", "--results", str(tmp_path)]).output
    assert "C1 dd-rq: no collision in training or application" in text
    assert "UNDECIDED, n = 0 episodes" in text


def test_nothing_recorded_leaves_every_claim_undecided_and_says_what_to_run(tmp_path: Path) -> None:
    found = _judged(tmp_path)
    assert {claim.verdict for claim in found.values()} == {Verdict.UNDECIDED}
    assert "dd-rq on b: no run; bench run --algo dd-rq --scenario b makes one" in found["C1"].reason
    values = claims.as_values(list(found.values()))
    assert (values[0]["effect"], values[0]["interval"], values[0]["n"]) == (None, None, 0)


@pytest.mark.parametrize(("flipped", "claim"), [("speed_mps", "C2"), ("flagged", "C3")])
def test_the_opposite_of_a_claim_refutes_it(tmp_path: Path, make_record: MakeRecord, flipped: str, claim: str) -> None:
    ours, theirs = {"speed_mps": (11.0, 12.0), "flagged": (0.06, 0.06)}[flipped]
    for seed in range(3):
        make_record(tmp_path, method="dd-rq", seed=seed, look={flipped: ours}, **FULL)
        for guard in GUARDS:
            make_record(tmp_path, method=guard, seed=seed, look={flipped: theirs}, **FULL)
    assert _judged(tmp_path)[claim].verdict is Verdict.NOT_REPRODUCED


def test_dd_rq_plus_is_judged_apart_and_only_where_it_ran(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="dd-rq", **FULL)
    assert list(_judged(tmp_path)) == ["C1", "C2", "C3", "C4", "C5"]
    make_record(tmp_path, method="dd-rq-plus", collisions=3, **FULL)
    found = _judged(tmp_path)
    assert list(found) == ["C1", "C2", "C3", "C4", "C5", "C1'", "C2'", "C3'", "C4'", "C5'"]
    assert (found["C1"].method, found["C1'"].method) == ("dd-rq", "dd-rq-plus")
    assert (found["C1"].verdict, found["C1'"].verdict) == (Verdict.UNDECIDED, Verdict.NOT_REPRODUCED)


def _part(verdict: Verdict, margin: float, effect: float = 1.0) -> Part:
    return Part("x", verdict, effect, Interval(0.0, 2.0), margin, "", (), f"margin {margin}", ())


def test_a_claim_holds_only_if_every_part_does_and_the_weakest_part_speaks_for_it() -> None:
    yes, no, open_ = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED, Verdict.UNDECIDED
    for verdicts, expected in (((yes, yes), yes), ((yes, open_), open_), ((open_, no), no), ((no, yes), no)):
        parts = tuple(_part(verdict, float(i)) for i, verdict in enumerate(verdicts))
        assert Claim("C", "m", "s", "u", parts).verdict is expected
    parts = (_part(yes, 0.5), _part(yes, 0.1), _part(yes, 0.9))
    assert Claim("C", "m", "s", "u", parts).deciding.margin == 0.1
    parts = (_part(open_, math.nan), _part(open_, 0.9))
    assert Claim("C", "m", "s", "u", parts).deciding.margin == 0.9


@pytest.mark.parametrize(
    ("narrow", "wide", "below", "expected"),
    [
        ((1.1, 2.0), (0.9, 2.2), False, Verdict.REPRODUCED),
        ((0.9, 2.0), (0.7, 2.2), False, Verdict.UNDECIDED),
        ((0.0, 0.9), (-0.1, 1.1), False, Verdict.UNDECIDED),
        ((0.0, 0.8), (-0.1, 0.9), False, Verdict.NOT_REPRODUCED),
        ((0.0, 0.9), (-0.1, 1.1), True, Verdict.REPRODUCED),
        ((1.1, 2.0), (0.9, 2.2), True, Verdict.UNDECIDED),
        ((1.2, 2.0), (1.1, 2.2), True, Verdict.NOT_REPRODUCED),
    ],
)
def test_the_interval_decides_and_a_refutation_needs_the_wider_one(
    standard_results: Path, narrow: tuple[float, float], wide: tuple[float, float], below: bool, expected: Verdict
) -> None:
    group = Evidence(collect(standard_results)).group("a", "dd-rq", "A")

    def estimate(level: float) -> Estimate:
        assert level in (0.95, pytest.approx(0.99))
        return Estimate(sum(narrow) / 2, Interval(*(narrow if level == 0.95 else wide), level), 3)

    part = compared("x", [group], estimate, bound=1.0, tests=5, show=lambda _: "", below=below)
    assert part.verdict is expected


def test_paired_tests_are_reported_with_holm_and_equal_methods_do_not_pass(
    standard_results: Path, tmp_path: Path, make_record: MakeRecord
) -> None:
    part = _judged(standard_results)["C4"].parts[1]
    assert part.name == "sac minus ours on a, A"
    assert part.reason.endswith("McNemar p < 0.0001")
    for seed in range(3):
        for method in ("dd-rq", "sac"):
            make_record(tmp_path, method=method, seed=seed, collisions=300, **FULL)
    part = _judged(tmp_path)["C4"].parts[1]
    assert part.verdict is Verdict.NOT_REPRODUCED
    assert part.reason.endswith("McNemar p 1.0000")


def test_learning_curve_by_hand(tmp_path: Path, make_record: MakeRecord) -> None:
    # Four episodes end at steps 500, 1000, 1500, 2000 of 2,000: two in each window of 1,000, the ends included.
    record = read_record(make_record(tmp_path, trained=4, train_collisions=1, look={"flagged": 0.5}))
    curve = learning_curve.of(record, 1_000)
    steps = record.train_episodes().column("steps").to_numpy()
    assert curve.stop.tolist() == [1_000, 2_000]
    assert curve.episodes.tolist() == [2, 2]
    assert curve.returns == pytest.approx([2.0 * steps[:2].mean() - 1.0, 2.0 * steps[2:].mean() - 1.0])
    assert curve.collision_rates.tolist() == [0.5, 0.0]
    assert curve.speeds_mps == pytest.approx([12.0, 12.0], rel=1e-4)
    assert curve.intervention_ratios == pytest.approx([0.5, 0.5], abs=0.01)
    assert curve.wall_s == pytest.approx([0.5, 2.0])
    assert len(learning_curve.of(record, 1_500).stop) == 1, "what is left of the budget is left out"
    with pytest.raises(ValueError, match="width = 0"):
        learning_curve.of(record, 0)


def test_the_return_after_so_many_steps_weighs_windows_not_episodes(tmp_path: Path, make_record: MakeRecord) -> None:
    record = read_record(make_record(tmp_path, trained=8))
    curve = learning_curve.of(record, 500)
    value, episodes = return_after(record, 1_000, 500)
    assert value == pytest.approx((curve.returns[2] + curve.returns[3]) / 2)
    assert episodes == 4
    assert math.isnan(return_after(record, 2_000, 500)[0])


def test_the_table_has_a_row_for_each_claim_with_what_decided(standard_results: Path, tmp_path: Path) -> None:
    found = claims.judge(collect(standard_results))
    claims.write(tmp_path, found)
    rows = (tmp_path / "claims.md").read_text().splitlines()[4:]
    assert [row.split(" | ")[0] for row in rows] == ["| C1", "| C2", "| C3", "| C4", "| C5"]
    assert rows[1].endswith(f"| reproduced | {found[1].reason} |")
