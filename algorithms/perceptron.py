"""Passes through ReLU perceptrons written out by hand: forward, backward, parameters as one vector."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Final, NamedTuple

import torch
from torch import Tensor, nn

from algorithms import sac_kernels
from algorithms.sac_kernels import Single

WIDE: Final = 128
"""Least inputs and outputs of a layer whose products are rounded to bfloat16; below, that is slower."""


class Shared(NamedTuple):
    """The same memory for torch and for compiled code."""

    tensor: Tensor
    array: Single


def shared(*shape: int) -> Shared:
    """Memory for so many numbers."""
    tensor = torch.zeros(*shape)
    return Shared(tensor, tensor.numpy())


@dataclass(frozen=True, slots=True)
class Layer:
    """A linear layer as products see it.

    Attributes:
        inputs: Their number.
        outputs: Likewise.
        weight: Shape (outputs, inputs).
        transposed: A view of it, shape (inputs, outputs).
        wide: Whether a processor's matrix unit pays.
        bias: Shape (outputs,).
        weight_gradient: Written by `Workspace.write_gradient`.
        bias_gradient: Likewise.
    """

    inputs: int
    outputs: int
    weight: Tensor
    transposed: Tensor
    wide: bool
    bias: Tensor
    weight_gradient: Tensor
    bias_gradient: Shared


class FlatModule:
    """All parameters of a module as one vector, and another one of all gradients; the module keeps views into both.

    Adam works element by element: over one long vector it has no per-parameter work.

    Attributes:
        vector: The parameters, with their gradients in ``grad``.

    Args:
        module: Its parameters and gradients become views.
    """

    def __init__(self, module: nn.Module) -> None:
        parameters = list(module.parameters())
        self.vector = nn.Parameter(torch.cat([parameter.detach().reshape(-1) for parameter in parameters]))
        self.vector.grad = torch.zeros_like(self.vector)
        sizes = [parameter.numel() for parameter in parameters]
        parts = zip(parameters, self.vector.data.split(sizes), self.vector.grad.split(sizes), strict=True)
        self._views = [(parameter, v.view_as(parameter), g.view_as(parameter)) for parameter, v, g in parts]
        self.gather()

    def gather(self) -> None:
        """Take in parameters that have been given memory of their own since, as by ``policy.load_from_vector``."""
        for parameter, value, gradient in self._views:
            if parameter.data_ptr() != value.data_ptr():
                value.copy_(parameter.data)
                parameter.data = value
            parameter.grad = gradient


def linear_layers(module: nn.Module) -> list[Layer]:
    """Linear layers of a module whose parameters are views into a `FlatModule`, or of a part of it, in order."""
    found = []
    for child in module.modules():
        if isinstance(child, nn.Linear):
            assert child.weight.grad is not None
            assert child.bias.grad is not None
            weight, wide = child.weight.data, min(child.weight.shape) >= WIDE
            by_bias = Shared(child.bias.grad, child.bias.grad.numpy())
            found.append(
                Layer(
                    child.in_features, child.out_features, weight, weight.t(), wide, child.bias.data,
                    child.weight.grad, by_bias,
                )
            )  # fmt: skip
    return found


class _Rounded:
    """Products of 32-bit floats within multiply in bfloat16, where the processor can, and add up in 32 bits."""

    def __enter__(self) -> None:
        torch.set_float32_matmul_precision("medium")

    def __exit__(self, *_: object) -> None:
        torch.set_float32_matmul_precision("highest")


_ROUNDED: Final = _Rounded()
_EXACT: Final = nullcontext()


def processor_rounds() -> bool:
    """Whether this processor has products in bfloat16; where it has none, torch multiplies in 32 bits instead."""
    nearly_one = torch.full((WIDE, WIDE), 1.0 + 2.0**-12)  # bfloat16 has eight bits: it becomes 1
    with _ROUNDED:
        return bool((nearly_one @ nearly_one == WIDE).all())


ACTOR, FIRST, SECOND, GRADIENT, BLOCK = range(5)
"""Who holds a buffer of a `Workspace`: hidden layers of the actor, of one critic or the other, gradients, sums."""


class Workspace:
    """Passes through ReLU perceptrons, and their buffers: products are written where the cache still holds the memory.

    Args:
        rounded: Whether products of wide layers round their factors to bfloat16.
    """

    def __init__(self, rounded: bool = False) -> None:
        self._rounded = rounded
        self._buffers: dict[tuple[int, ...], Shared] = {}

    def _precision_of(self, layer: Layer) -> AbstractContextManager[None]:
        return _ROUNDED if self._rounded and layer.wide else _EXACT

    def buffer(self, holder: int, index: int, rows: int, width: int) -> Shared:
        """The buffer of a holder's layer, shape (rows, width), with whatever was written to it last."""
        key = (holder, index, rows, width)
        if key not in self._buffers:
            self._buffers[key] = shared(rows, width)
        return self._buffers[key]

    def forward(self, layers: list[Layer], x: Tensor, holder: int, out: Tensor) -> list[Tensor]:
        """Activations of a perceptron: input, hidden layers after ReLU, linear output, which is written to `out`.

        The holder's next pass overwrites the hidden layers.
        """
        activations = [x]
        for index, layer in enumerate(layers[:-1]):
            activations.append(self._hidden(layer, activations[-1], holder, index))
        activations.append(torch.addmm(layers[-1].bias, activations[-1], layers[-1].transposed, out=out))
        return activations

    def _hidden(self, layer: Layer, x: Tensor, holder: int, index: int) -> Tensor:
        """Output of a hidden layer after its ReLU."""
        out = self.buffer(holder, index, x.shape[0], layer.outputs)
        with self._precision_of(layer):
            torch.mm(x, layer.transposed, out=out.tensor)
        sac_kernels.bias_and_relu(out.array, layer.bias.numpy())
        return out.tensor

    def gradient_of_inputs(
        self, layers: list[Layer], activations: list[Tensor], gradient: Tensor, inputs: int, out: Tensor
    ) -> None:
        """Propagate the gradient of the output to so many of the last inputs; written to `out`, (batch, inputs)."""
        for index in range(len(layers) - 1, 0, -1):
            layer, before = layers[index], activations[index]
            passed = self.buffer(GRADIENT, index % 2, before.shape[0], layer.inputs)
            with self._precision_of(layer):
                torch.mm(gradient, layer.weight, out=passed.tensor)
            sac_kernels.through_relu(passed.array, before.numpy())
            gradient = passed.tensor
        torch.mm(gradient, layers[0].weight[:, -inputs:], out=out)

    def write_gradients(self, layers: list[Layer], activations: list[Tensor], gradient: Tensor) -> None:
        """Propagate the gradient of the output, and write those of all weights and biases."""
        torch.sum(gradient, 0, out=layers[-1].bias_gradient.tensor)
        self.write_inner_gradients(layers, activations, gradient)

    def write_inner_gradients(self, layers: list[Layer], activations: list[Tensor], gradient: Tensor) -> None:
        """The same but for the bias of the last layer, which has been written."""
        for index in range(len(layers) - 1, -1, -1):
            layer, before = layers[index], activations[index]
            with self._precision_of(layer):
                torch.mm(gradient.t(), before, out=layer.weight_gradient)
                if index == 0:
                    return
                passed = self.buffer(GRADIENT, index % 2, before.shape[0], layer.inputs)
                torch.mm(gradient, layer.weight, out=passed.tensor)
            self.through_relu(passed.array, before, layers[index - 1])
            gradient = passed.tensor

    def through_relu(self, gradient: Single, output: Tensor, layer: Layer) -> None:
        """Keep, in place, the gradient where the output of a layer's ReLU is positive; write that of its bias."""
        room = self.buffer(BLOCK, 0, 1, layer.outputs).array[0]
        sac_kernels.through_relu_and_bias(gradient, output.numpy(), layer.bias_gradient.array, room)
