"""The risk quantification model (paper, Sec. III, Alg. 1): a pre-norm transformer from the scene to T_c."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.nn import functional

from algorithms.risk_kernel import fold, risk_kernel
from envs.actions import HORIZON_MAX_S, HORIZON_MIN_S
from envs.observation import (
    EGO_FEATURES,
    LAYOUT_VERSION,
    PEDESTRIAN_MASK_AT,
    PEDESTRIANS_AT,
    VEHICLE_FEATURES,
    VEHICLE_MASK_AT,
    VEHICLES_AT,
)
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import FloatArray

FORMAT: Final = "safedrive-bench risk model 1"
OBJECTS: Final = VEHICLE_SLOTS + PEDESTRIAN_SLOTS
FEATURES: Final = EGO_FEATURES
"""P: features of a token; a pedestrian's three take the places of ds, dd and v_d."""
EGO_TYPE, VEHICLE_TYPE, PEDESTRIAN_TYPE = 0, 1, 2
K1: Final = -7.0 / 200.0
B1: Final = 4.0
"""T_c = k1 RQ + b1 with RQ in percent (paper, appendix)."""

Observations = npt.NDArray[np.float32]


class RiskModelFileError(ValueError):
    """A saved risk model cannot be used; the message says which file and why."""


@dataclass(frozen=True, slots=True)
class RiskArchitecture:
    """Sizes of the encoder.

    Attributes:
        width: D, of a token's embedding.
        heads: Attention heads; divides width.
        layers: Encoder blocks L.
        hidden: Width of the MLP in a block.

    Raises:
        ValueError: Sizes do not divide as the compiled network needs it.
    """

    width: int = 32
    heads: int = 4
    layers: int = 2
    hidden: int = 64

    def __post_init__(self) -> None:
        """Refuse sizes that the compiled network cannot take."""
        if self.width % 4 or self.hidden % 4 or self.width % self.heads:
            raise ValueError(f"{self}: width and hidden must be multiples of 4, width also of heads.")


def tokenise(observations: Tensor) -> tuple[Tensor, Tensor]:
    """Tokens (N, 9, 5) for ego, 5 vehicles, 3 pedestrians and whether each is present (N, 9)."""
    n = len(observations)
    ego = observations[:, None, :EGO_FEATURES]
    vehicles = observations[:, VEHICLES_AT:PEDESTRIANS_AT].reshape(n, VEHICLE_SLOTS, VEHICLE_FEATURES)
    people = observations[:, PEDESTRIANS_AT:VEHICLE_MASK_AT].reshape(n, PEDESTRIAN_SLOTS, 3)
    padded = observations.new_zeros(n, PEDESTRIAN_SLOTS, FEATURES)
    padded[:, :, :2] = people[:, :, :2]
    padded[:, :, 3] = people[:, :, 2]
    masks = observations[:, VEHICLE_MASK_AT : PEDESTRIAN_MASK_AT + PEDESTRIAN_SLOTS] > 0.5
    present = torch.cat([torch.ones(n, 1, dtype=torch.bool), masks], 1)
    return torch.cat([ego, vehicles, padded], 1), present


class EncoderBlock(nn.Module):
    """z' = MSA(LN(z)) + z; z = MLP(LN(z')) + z' (paper, Eq. MSA)."""

    def __init__(self, size: RiskArchitecture) -> None:
        """Build the block, untrained."""
        super().__init__()
        self.heads = size.heads
        self.norm_attention = nn.LayerNorm(size.width)
        self.query_key_value = nn.Linear(size.width, 3 * size.width)
        self.project = nn.Linear(size.width, size.width)
        self.norm_mlp = nn.LayerNorm(size.width)
        self.expand = nn.Linear(size.width, size.hidden)
        self.contract = nn.Linear(size.hidden, size.width)

    def forward(self, z: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Next tokens (N, 9, D) and attention weights (N, heads, 9, 9): softmax(Q K^T / sqrt(d_k)), Eq. QKV."""
        n, tokens, width = z.shape
        packed = self.query_key_value(self.norm_attention(z)).reshape(n, tokens, 3, self.heads, -1)
        query, key, value = packed.permute(2, 0, 3, 1, 4)
        scores = query @ key.transpose(-1, -2) / math.sqrt(width // self.heads)
        weights = scores.masked_fill(~present[:, None, None, :], -math.inf).softmax(-1)
        z = z + self.project((weights @ value).transpose(1, 2).reshape(n, tokens, width))
        return z + self.contract(functional.gelu(self.expand(self.norm_mlp(z)))), weights


class RiskNetwork(nn.Module):
    """Embedding of each object's token, encoder blocks, LN of the ego's token, T_c."""

    def __init__(self, size: RiskArchitecture) -> None:
        """Build the network, untrained."""
        super().__init__()
        self.embed = nn.Linear(FEATURES, size.width, bias=False)
        self.kind = nn.Embedding(3, size.width)
        self.blocks = nn.ModuleList(EncoderBlock(size) for _ in range(size.layers))
        self.norm = nn.LayerNorm(size.width)
        self.head = nn.Linear(size.width, 1)
        kinds = [EGO_TYPE] + [VEHICLE_TYPE] * VEHICLE_SLOTS + [PEDESTRIAN_TYPE] * PEDESTRIAN_SLOTS
        self.register_buffer("kinds", torch.tensor(kinds), persistent=False)

    def forward(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Value of the head (N,) and the last block's attention (N, heads, 9, 9) for observations (N, 47)."""
        tokens, present = tokenise(observations)
        z = self.embed(tokens) + self.kind(self.kinds)
        weights = z.new_zeros(0)
        for block in self.blocks:
            z, weights = block(z, present)
        return self.head(self.norm(z[:, 0]))[:, 0], weights


def risk_percent(phi: FloatArray, printed: bool = False) -> FloatArray:
    """RQ of a planning time, 0 to 100 %.

    Source: paper, Sec. III-C. Deviation: RQ = 100 (T_max - phi) / (T_max - T_min), so that a larger value is
    riskier and k1, b1 give back T_c = phi; the printed formula has the opposite sign.

    Args:
        phi: Predicted T_c, clipped to [0.5, 4], shape (N,) [s].
        printed: Use the printed formula.
    """
    share = (np.clip(phi, HORIZON_MIN_S, HORIZON_MAX_S) - HORIZON_MIN_S) / (HORIZON_MAX_S - HORIZON_MIN_S)
    return 100.0 * (share if printed else 1.0 - share)


def adjustment_time(risk: FloatArray) -> FloatArray:
    """T_c = k1 RQ + b1, 0.5 to 4 s, of RQ in percent, shape (N,) [s]."""
    return K1 * risk + B1


@dataclass(frozen=True, slots=True)
class RiskOutput:
    """What the model says of N scenes.

    Attributes:
        value: Output of the head: T_c [s], shape (N,).
        importance: IR of each object slot in [0, 1], sums to 1 over present objects, shape (N, 8).
    """

    value: FloatArray
    importance: FloatArray


class RiskModel:
    """A trained risk network with the description of what it was trained on."""

    def __init__(self, network: RiskNetwork, architecture: RiskArchitecture, description: dict[str, Any]) -> None:
        """Take a trained network; the description is kept in the JSON beside the weights."""
        self.network = network.requires_grad_(False).eval()
        self.architecture = architecture
        self.description = description
        state = {name: value.numpy() for name, value in self.network.state_dict().items()}
        self._weights = fold(state, architecture.layers, architecture.heads)

    def __call__(self, observations: Observations) -> RiskOutput:
        """Evaluate N scenes, observations (N, 47); a scene's output does not depend on the others."""
        output = RiskOutput(np.empty(len(observations)), np.empty((len(observations), OBJECTS)))
        rows = np.ascontiguousarray(observations, np.float32)
        risk_kernel(rows, self._weights, self.architecture.heads, output.value, output.importance)
        return output

    def save(self, folder: Path) -> None:
        """Write ``risk.safetensors`` and ``risk.json``."""
        save_file({k: v.contiguous() for k, v in self.network.state_dict().items()}, folder / "risk.safetensors")
        text = {
            "format": FORMAT,
            "layout_version": LAYOUT_VERSION,
            "architecture": asdict(self.architecture),
            "description": self.description,
        }
        (folder / "risk.json").write_text(json.dumps(text, indent=1, sort_keys=True) + "\n")

    @classmethod
    def load(cls, folder: Path, scenario_id: str | None = None) -> RiskModel:
        """Read what `save` wrote; no code is executed.

        Args:
            folder: Where it was saved.
            scenario_id: Name and version of the scenario it is wanted for, or None for any.

        Raises:
            RiskModelFileError: A file is missing, damaged, or of another format, state layout or scenario version, or
                a weight is not finite.
        """
        path = folder / "risk.json"
        try:
            text = json.loads(path.read_text())
            if text.get("format") != FORMAT or text.get("layout_version") != LAYOUT_VERSION:
                raise RiskModelFileError(
                    f"{path}: format {text.get('format')!r}, state layout {text.get('layout_version')!r}; this "
                    f"version reads {FORMAT!r}, layout {LAYOUT_VERSION}. Train it anew."
                )
            trained_on = text["description"].get("scenario")
            if scenario_id is not None and trained_on != scenario_id:
                raise RiskModelFileError(
                    f"{path}: trained for scenario {trained_on!r}, wanted for {scenario_id!r}. Train it anew."
                )
            architecture = RiskArchitecture(**text["architecture"])
            network = RiskNetwork(architecture)
            network.load_state_dict(load_file(folder / "risk.safetensors"))
            for name, values in network.state_dict().items():
                if not values.isfinite().all():
                    raise RiskModelFileError(f"{folder}: weights {name!r} are not all finite. Train it anew.")
        except RiskModelFileError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise RiskModelFileError(f"{folder}: not a readable risk model ({reason}).") from error
        return cls(network, architecture, text["description"])
