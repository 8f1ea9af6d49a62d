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

    @classmethod
    def of(cls, tensor: Tensor) -> Shared:
        """That of a tensor."""
        return cls(tensor, tensor.numpy())

    def first(self, rows: int) -> Shared:
        """The first rows."""
        return Shared(self.tensor[:rows], self.array[:rows])


def shared(*shape: int) -> Shared:
    """Memory for so many numbers."""
    return Shared.of(torch.zeros(*shape))


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
        weight_gradient: Written by `Workspace.write_gradients`.
        bias_gradient: Likewise.
    """

    inputs: int
    outputs: int
    weight: Tensor
    transposed: Tensor
    wide: bool
    bias: Shared
    weight_gradient: Tensor
    bias_gradient: Shared

    def apply(self, x: Shared, out: Shared) -> None:
        """Write x weight^T + bias, shape (batch, outputs), to `out`."""
        torch.addmm(self.bias.tensor, x.tensor, self.transposed, out=out.tensor)


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
        self._gradient = torch.zeros_like(self.vector.data)
        sizes = [parameter.numel() for parameter in parameters]
        parts = zip(parameters, self.vector.data.split(sizes), self._gradient.split(sizes), strict=True)
        self._views = [(parameter, v.view_as(parameter), g.view_as(parameter)) for parameter, v, g in parts]
        self.gather()

    def gather(self) -> None:
        """Take in parameters that have been given memory of their own since, as by ``policy.load_from_vector``.

        Raises:
            ValueError: This is a copy, in which vector and views have memory of their own.
        """
        if self._views[0][1].data_ptr() != self.vector.data_ptr():
            raise ValueError("a copy of FastSAC cannot train: save the learner and load it instead")
        self.vector.grad = self._gradient
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
            bias, by_bias = Shared.of(child.bias.data), Shared.of(child.bias.grad)
            sizes = child.in_features, child.out_features
            found.append(Layer(*sizes, weight, weight.t(), wide, bias, child.weight.grad, by_bias))
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

    def forward(self, layers: list[Layer], x: Shared, holder: int, out: Shared) -> list[Shared]:
        """Activations of a perceptron: input, hidden layers after ReLU, linear output, which is written to `out`.

        The holder's next pass overwrites the hidden layers.
        """
        activations = [x]
        for index, layer in enumerate(layers[:-1]):
            activations.append(self._hidden(layer, activations[-1], holder, index))
        layers[-1].apply(activations[-1], out)
        return [*activations, out]

    def _hidden(self, layer: Layer, x: Shared, holder: int, index: int) -> Shared:
        """Output of a hidden layer after its ReLU."""
        out = self.buffer(holder, index, x.tensor.shape[0], layer.outputs)
        with self._precision_of(layer):
            torch.mm(x.tensor, layer.transposed, out=out.tensor)
        sac_kernels.bias_and_relu(out.array, layer.bias.array)
        return out

    def gradient_of_inputs(
        self, layers: list[Layer], activations: list[Shared], gradient: Shared, inputs: int, out: Shared
    ) -> None:
        """Propagate the gradient of the output to so many of the last inputs; written to `out`, (batch, inputs)."""
        for index in range(len(layers) - 1, 0, -1):
            passed = self._before(layers[index], index, gradient)
            with self._precision_of(layers[index]):
                torch.mm(gradient.tensor, layers[index].weight, out=passed.tensor)
            sac_kernels.through_relu(passed.array, activations[index].array)
            gradient = passed
        torch.mm(gradient.tensor, layers[0].weight[:, -inputs:], out=out.tensor)

    def write_gradients(self, layers: list[Layer], activations: list[Shared], gradient: Shared) -> None:
        """Propagate the gradient of the output, and write those of all weights and biases."""
        torch.sum(gradient.tensor, 0, out=layers[-1].bias_gradient.tensor)
        self.write_inner_gradients(layers, activations, gradient)

    def write_inner_gradients(self, layers: list[Layer], activations: list[Shared], gradient: Shared) -> None:
        """The same but for the bias of the last layer, which has been written."""
        for index in range(len(layers) - 1, -1, -1):
            layer, before = layers[index], activations[index]
            with self._precision_of(layer):
                torch.mm(gradient.tensor.t(), before.tensor, out=layer.weight_gradient)
                if index == 0:
                    return
                passed = self._before(layer, index, gradient)
                torch.mm(gradient.tensor, layer.weight, out=passed.tensor)
            self.through_relu(passed, before, layers[index - 1])
            gradient = passed

    def _before(self, layer: Layer, index: int, gradient: Shared) -> Shared:
        """Room for the gradient of a layer's inputs; that of its outputs lies in the other of two."""
        return self.buffer(GRADIENT, index % 2, gradient.tensor.shape[0], layer.inputs)

    def through_relu(self, gradient: Shared, output: Shared, layer: Layer) -> None:
        """Keep, in place, the gradient where the output of a layer's ReLU is positive; write that of its bias."""
        room = self.buffer(BLOCK, 0, 1, layer.outputs).array[0]
        sac_kernels.through_relu_and_bias(gradient.array, output.array, layer.bias_gradient.array, room)
