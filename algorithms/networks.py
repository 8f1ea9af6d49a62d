"""Deterministic network policies: what is left of a learner in application, saved without pickle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, Self

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from algorithms.method import Actions, Observations, Policy
from envs.driving_env import ActionMode, action_space
from envs.observation import LAYOUT_VERSION, OBSERVATION_SIZE
from envs.world import Shield

FORMAT: Final = "safedrive-bench policy 1"
_ACTIVATIONS: Final[dict[str, type[torch.nn.Module]]] = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


class Features(Protocol):
    """What a policy sees beside the state of Table I.

    Attributes:
        size: Entries of an observation and its features.
    """

    size: int

    def __call__(self, observations: Observations) -> Observations:
        """Observations (N, 47) with their features behind them, (N, size)."""
        ...


class PolicyFileError(ValueError):
    """A saved policy cannot be used; the message says which file and why."""


@dataclass(frozen=True, slots=True)
class Architecture:
    """A multi-layer perceptron from observation to action mean.

    Attributes:
        sizes: Widths from input to output, for example (47, 256, 256, 256, 256, 2).
        activation: ``relu`` or ``tanh``, between layers.
        squashed: Whether the output passes through tanh before scaling to the action bounds (SAC), or is
            clipped to [-1, 1] (on-policy methods).
    """

    sizes: tuple[int, ...]
    activation: str
    squashed: bool

    def build(self) -> torch.nn.Sequential:
        """The network, untrained."""
        layers: list[torch.nn.Module] = []
        for width_in, width_out in zip(self.sizes, self.sizes[1:], strict=False):
            layers += [torch.nn.Linear(width_in, width_out), _ACTIVATIONS[self.activation]()]
        return torch.nn.Sequential(*layers[:-1])


class NetworkPolicy(Policy):
    """The mean action of a trained actor, with the shield it was trained behind."""

    def __init__(
        self,
        architecture: Architecture,
        network: torch.nn.Sequential,
        action_mode: ActionMode = ActionMode.ACCELERATION,
        shield: Shield | None = None,
        features: Features | None = None,
    ) -> None:
        """Take a trained network, and what it sees beside the observation."""
        self.architecture = architecture
        self.network = network.requires_grad_(False).eval()
        self.action_mode = action_mode
        self.shield = shield
        self.features = features
        space = action_space(action_mode)
        self._low = np.asarray(space.low, np.float64)
        self._high = np.asarray(space.high, np.float64)

    def begin(self, worlds: int, seed: np.random.SeedSequence) -> None:
        """Pass the seed on to the shield; the mean action needs none."""
        if self.shield is not None:
            self.shield.begin(seed)

    def act(self, observations: Observations) -> Actions:
        """Mean actions (N, A) in physical units."""
        seen = observations if self.features is None else self.features(observations)
        with torch.no_grad():
            raw = self.network(torch.from_numpy(np.ascontiguousarray(seen)))
            unit = torch.tanh(raw) if self.architecture.squashed else raw.clamp(-1.0, 1.0)
        actions: Actions = self._low + 0.5 * (unit.numpy().astype(np.float64) + 1.0) * (self._high - self._low)
        return actions

    def save(self, folder: Path) -> None:
        """Write ``actor.safetensors`` and ``actor.json``."""
        save_file(
            {key: value.contiguous() for key, value in self.network.state_dict().items()},
            folder / "actor.safetensors",
        )
        description = {
            "format": FORMAT,
            "layout_version": LAYOUT_VERSION,
            "sizes": list(self.architecture.sizes),
            "activation": self.architecture.activation,
            "squashed": self.architecture.squashed,
            "action_mode": self.action_mode.value,
        }
        (folder / "actor.json").write_text(json.dumps(description, indent=1, sort_keys=True) + "\n")

    @classmethod
    def load(cls, folder: Path, shield: Shield | None = None, features: Features | None = None) -> Self:
        """Read what `save` wrote; no code is executed.

        Raises:
            PolicyFileError: A file is missing, damaged, or of another format, state layout or width.
        """
        try:
            text: dict[str, Any] = json.loads((folder / "actor.json").read_text())
            if text.get("format") != FORMAT or text.get("layout_version") != LAYOUT_VERSION:
                raise PolicyFileError(
                    f"{folder / 'actor.json'}: format {text.get('format')!r}, state layout "
                    f"{text.get('layout_version')!r}; this version reads {FORMAT!r}, layout {LAYOUT_VERSION}."
                )
            seen = OBSERVATION_SIZE if features is None else features.size
            if text["sizes"][0] != seen:
                raise PolicyFileError(
                    f"{folder / 'actor.json'}: the policy sees {text['sizes'][0]} values, this method shows {seen}; "
                    "load it with the parameters it was trained with (aware)."
                )
            architecture = Architecture(tuple(text["sizes"]), text["activation"], text["squashed"])
            network = architecture.build()
            network.load_state_dict(load_file(folder / "actor.safetensors"))
        except PolicyFileError:
            raise
        except Exception as error:
            raise PolicyFileError(f"{folder}: not a readable policy ({type(error).__name__}: {error}).") from error
        return cls(architecture, network, ActionMode(text["action_mode"]), shield, features)


def copy_linear_layers(layers: Sequence[torch.nn.Linear], target: torch.nn.Sequential) -> None:
    """Copy the weights of linear layers, in order, into the linear layers of a network."""
    own = [module for module in target if isinstance(module, torch.nn.Linear)]
    for source, destination in zip(layers, own, strict=True):
        destination.load_state_dict(source.state_dict())
