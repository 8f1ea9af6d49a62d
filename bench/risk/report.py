"""The risk report: trained models in, figures in numbers and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from algorithms.atomic import write_file
from algorithms.driving_agent import DrivingAgentSpec, driving_agent
from algorithms.method import Policy
from algorithms.risk_model import RiskModel
from algorithms.risk_training import CONTACT_WITHIN_S, RiskSettings, risk_model
from bench.errors import UsageError
from bench.risk import episodes, figures, measures
from bench.risk.rollouts import METHODS, Rollouts, roll_out
from bench.text import json_text
from envs.scenario import Scenario, get_scenario
from envs.world import Ending

SHOWN = {"goal": Ending.GOAL, "contact": Ending.COLLISION}
"""Endings of the episodes that are drawn."""
TRAINING = ("r2_held_out", "mse_held_out", "spearman_held_out", "auc_held_out", "label_mean", "label_sd")
"""Figures of a model's own training that the report repeats; slightly optimistic, as they chose the epoch too."""


def command(scenario_name: str, agent_steps: int, cache: Path, out: Path) -> dict[str, Any]:
    """Train or fetch the models, measure them, and write JSON, Markdown and figures into ``out``.

    Raises:
        UsageError: The scenario is unknown, or the budget does not fit it.
    """
    try:
        scenario = get_scenario(scenario_name)
        agent, models = load(scenario, agent_steps, cache)
    except ValueError as error:
        raise UsageError(str(error)) from error
    rollouts = roll_out(agent, models, scenario)
    found = measure(scenario, agent_steps, models, rollouts)
    out.mkdir(parents=True, exist_ok=True)
    write_file(out / "report.json", (json_text(found) + "\n").encode())
    figures.write(figures.planning_times(rollouts, list(models)), out / "planning-times")
    figures.write(figures.reliability_plot(found["models"]), out / "reliability")
    for name, ending in SHOWN.items():
        episode = episodes.first_ending(agent, models, scenario, ending)
        for method in models:
            figures.write(figures.episode_figure(episode, method), out / f"{name}-{method}")
    write_file(out / "report.md", as_markdown(found).encode())
    return found


def load(scenario: Scenario, agent_steps: int, cache: Path) -> tuple[Policy, dict[str, RiskModel]]:
    """The driving agent and the model of each method, from the cache or trained now."""
    agent = driving_agent(DrivingAgentSpec(scenario.name, agent_steps), cache)
    models = {
        method: risk_model(scenario, agent_steps, cache, RiskSettings.for_agent(agent_steps, label))
        for label, method in METHODS.items()
    }
    return agent, models


def measure(scenario: Scenario, agent_steps: int, models: dict[str, RiskModel], rollouts: Rollouts) -> dict[str, Any]:
    """All figures as plain values."""
    judged = {}
    for method, model in models.items():
        training = {key: model.description[key] for key in TRAINING if key in model.description}
        judged[method] = {**measures.judge(rollouts, method), "training": training}
    return {
        "scenario": scenario.id,
        "agent_steps": agent_steps,
        "agent": next(iter(models.values())).description["agent"],
        "scenes": len(rollouts.episodes),
        "episodes": len(set(rollouts.episodes.tolist())),
        "contact_within_s": CONTACT_WITHIN_S,
        "contact_rate": float(rollouts.contact.mean()),
        "planning_time_s": measures.distribution(rollouts.planning_times),
        "models": judged,
    }


def _with_interval(estimate: dict[str, Any], digits: int) -> str:
    value, low, high = (estimate[key] for key in ("value", "low", "high"))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def as_markdown(found: dict[str, Any]) -> str:
    """The report for people."""
    tc, models = found["planning_time_s"], found["models"]
    lines = [
        f"# Risk in scenario {found['scenario']}",
        "",
        f"Driving agent of {found['agent_steps']:,} steps (`{found['agent']}`), {found['scenes']:,} scenes of "
        f"{found['episodes']:,} own episodes in randomised traffic that no model was trained on; contact within "
        f"{found['contact_within_s']:.0f} s follows {100.0 * found['contact_rate']:.1f} % of them. Written by "
        f"`bench risk report --scenario {found['scenario'].rpartition('-v')[0]} --agent-steps {found['agent_steps']}`.",
        "",
        f"T_c of the agent: mean {tc['mean']:.2f} s, sd {tc['sd']:.2f} s, quartiles {tc['quantiles']['0.25']:.2f}, "
        f"{tc['quantiles']['0.5']:.2f}, {tc['quantiles']['0.75']:.2f} s.",
        "",
        "| RQ of | mean | Spearman with 1/TTC | Spearman with contact within 3 s | ROC area | calibration error |",
        "|---|---|---|---|---|---|",
    ]
    for method, row in models.items():
        note = "" if row["is_probability"] else " (RQ / 100 is no probability)"
        lines.append(
            f"| `{method}` | {row['risk_percent']['mean']:.1f} % | {_with_interval(row['spearman_inverse_ttc'], 3)} | "
            f"{_with_interval(row['spearman_contact'], 3)} | {_with_interval(row['auc_contact'], 4)} | "
            f"{row['expected_calibration_error']:.3f}{note} |"
        )
    lines += [
        "",
        "Intervals: 95 %, bootstrap over episodes. The calibration error is the mean distance of RQ / 100 from the",
        "rate of contact, over ten bins. RQ of `dd-rq-plus` is a probability by its training; that of `dd-rq` is the",
        "agent's planning time turned round, a score: its error says how far off it is if read as a probability.",
        "Held-out figures of the training itself (`training` in `report.json`) are slightly optimistic: the held-out",
        "worlds also chose the epoch.",
        "",
        "![T_c and RQ](planning-times.png)",
        "",
        "![Reliability](reliability.png)",
    ]
    titles = {"goal": "first episode of the stream that reaches the goal", "contact": "first that ends in contact"}
    for name in SHOWN:
        for method in models:
            lines += ["", f"`{method}`, {titles[name]}:", "", f"![{name}, {method}]({name}-{method}.png)"]
    return "\n".join(lines) + "\n"
