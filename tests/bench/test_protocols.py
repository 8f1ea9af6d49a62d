"""Requests become specifications; what cannot be meant is refused with the value and the remedy."""

from pathlib import Path

import pytest

from algorithms.omnisafe_methods import CPO
from algorithms.registry import UnavailableMethodError
from bench.errors import UsageError
from bench.protocols import PROTOCOLS, Request, expand, parse_seeds, split_names


@pytest.mark.parametrize(
    ("text", "items"),
    [
        ("sac", ["sac"]),
        ("sac,cpo", ["sac", "cpo"]),
        ("x:p=1,q=2,y", ["x:p=1,q=2", "y"]),
        ("x:p=1,y:q=2,r=3", ["x:p=1", "y:q=2,r=3"]),
        (" a , b ,", ["a", "b"]),
        ("a,a", ["a"]),
    ],
)
def test_a_comma_list_keeps_parameters_with_their_name(text: str, items: list[str]) -> None:
    assert split_names(text) == items


@pytest.mark.parametrize("text", ["", ",", "q=2", "sac,q=2"])
def test_a_comma_list_without_a_name_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        split_names(text)


@pytest.mark.parametrize(("text", "seeds"), [("3", [0, 1, 2]), ("0,1,7", [0, 1, 7]), ("7,", [7])])
def test_seeds_are_a_number_or_a_list(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["0", "-1", "1,1", "0,-2", "x", ",", "1.5"])
def test_impossible_seeds_are_refused_by_name(text: str) -> None:
    with pytest.raises(UsageError, match="--seeds"):
        parse_seeds(text)


@pytest.mark.parametrize("text", ["1000000000", "10001", "1" + "0" * 30, ",".join(map(str, range(10_001)))])
def test_more_seeds_than_anybody_means_are_refused_before_they_are_counted_out(text: str) -> None:
    with pytest.raises(UsageError, match=r"--seeds asks for 10+1? seeds: at most 10,000"):
        parse_seeds(text)


def test_as_many_seeds_as_the_limit_allows_are_taken() -> None:
    assert len(parse_seeds("10000")) == 10_000


def test_the_protocols_have_the_budgets_of_the_method_page() -> None:
    assert {p.name: (p.steps, p.seeds, p.eval_episodes) for p in PROTOCOLS.values()} == {
        "smoke": (4_000, 1, 64),
        "quick": (100_000, 1, 1_000),
        "standard": (500_000, 5, 10_000),
        "paper": (1_000_000, 5, 10_000),
    }


def test_a_protocol_expands_over_methods_scenarios_and_seeds(fakes: Path) -> None:
    specs = expand(Request("fake-learner,fake-failing", "a,b", "standard")).specs
    assert len({spec.hash for spec in specs}) == len(specs) == 2 * 2 * 5
    assert {spec.steps for spec in specs} == {500_000}
    assert {spec.eval_episodes for spec in specs} == {10_000}


def test_a_method_that_does_not_train_runs_once_for_each_scenario(fakes: Path) -> None:
    specs = expand(Request("fake-scripted", "a,b", "standard")).specs
    assert [(spec.scenario, spec.seed, spec.steps) for spec in specs] == [("a", 0, 0), ("b", 0, 0)]


def test_two_spellings_of_one_method_are_one_run(fakes: Path) -> None:
    specs = expand(Request("fake-learner,fake-learner:offset=0.0,fake-learner:offset=1,bias=2", "a")).specs
    assert [spec.method for spec in specs] == ["fake-learner", "fake-learner:bias=2.0,offset=1.0"]


def test_settings_reach_their_target_only(fakes: Path) -> None:
    settings = ["cost.limit=0.1", "cost.signal=proximity", "scenario.decision_period_s=0.1", "fake-learner.pace=2"]
    first, second = expand(Request("fake-learner,fake-scripted", "b:vehicles=7", settings=settings)).specs
    assert first.cost_limit == 0.1
    assert first.cost_signal == "proximity"
    assert first.scenario == "b:decision_period_s=0.1,vehicles=7"
    assert dict(first.settings) == {"pace": "2"}
    assert dict(second.settings) == {}


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (Request("fake-lerner"), "Did you mean fake-learner"),
        (Request("fake-learner:ofset=1"), "Did you mean offset"),
        (Request("fake-learner:offset=x"), "expected float"),
        (Request("broken"), "cannot be used here"),
        (Request("fake-learner", "aa"), "Unknown scenario 'aa'"),
        (Request("fake-learner", "a:vehicels=3"), "Did you mean vehicles"),
        (Request("fake-learner", "a:vehicles=0"), "must be 1 to"),
        (Request("fake-learner", protocol="smok"), "Did you mean smoke"),
        (Request("fake-learner", steps=4_001), "nearest: 4000"),
        (Request("fake-learner", steps=0), "nearest: 5"),
        (Request("fake-learner", eval_episodes=0), "eval_episodes"),
        (Request("fake-learner", settings=["cost.limt=1"]), "Did you mean cost.limit"),
        (Request("fake-learner", settings=["cost.limit"]), "expected KEY=VALUE"),
        (Request("fake-learner", settings=["cost.limit=-1"]), "at least 0"),
        (Request("fake-learner", settings=["cost.limit=nan"]), "at least 0"),
        (Request("fake-learner", settings=["cost.signal=tcc"]), "Did you mean ttc"),
        (Request("fake-learner", settings=["fake-learner.pase=1"]), "Did you mean fake-learner.pace"),
        (Request("fake-scripted", settings=["fake-learner.pace=1"]), "Unknown setting 'fake-learner.pace'"),
        (Request("fake-learner", settings=["scenario.decision_period=1"]), "decision_period_s"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_a_remedy(fakes: Path, request_: Request, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        expand(request_)


def test_all_is_the_six_of_the_paper_and_the_reference_drivers(fakes: Path) -> None:
    expansion = expand(Request("all", "b", "smoke"))
    named = {spec.method for spec in expansion.specs} | set(expansion.unavailable)
    assert named == {
        *("dd-rq", "safety-guard", "sac", "cpo", "focops", "trpo-lag"),
        *("idm", "random+guard", "cruise+guard", "rss-guard"),
        *("random", "cruise", "constant-speed", "constant-speed+guard"),
    }, "no plugin changes what all means"
    trained = {spec.method for spec in expansion.specs if spec.steps}
    assert "rss-guard" in trained
    assert "cruise+guard" not in trained
    more = {spec.method for spec in expand(Request("safety-guard:tc=1.0,all", "b", "smoke")).specs}
    assert more == {spec.method for spec in expansion.specs} | {"safety-guard:tc=1.0"}


def test_all_names_what_is_unavailable_and_runs_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(cls: type) -> None:
        raise UnavailableMethodError("OmniSafe is gone")

    monkeypatch.setattr(CPO, "check_available", classmethod(refuse))
    expansion = expand(Request("all", "a", "smoke"))
    assert expansion.unavailable == {"cpo": "OmniSafe is gone"}
    assert {"sac", "cruise", "rss-guard"} <= {spec.method for spec in expansion.specs}
