"""Passes through ReLU perceptrons written out by hand: forward, backward, parameters as one vector."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass(frozen=True, slots=True)
class Layer:
    """A linear layer as products see it.

    Attributes:
        weight: Shape (outputs, inputs), in the precision of products.
        bias: Shape (outputs,), in the precision of products.
        weight_gradient: Written by `write_gradient`, 32 bits.
        bias_gradient: Likewise.
    """

    weight: Tensor
    bias: Tensor
    weight_gradient: Tensor
    bias_gradient: Tensor


class FlatModule:
    """All parameters of a module as one vector, and another one of all gradients; the module keeps views into both.

    Adam works element by element: over one long vector it has no per-parameter work.

    Attributes:
        vector: The parameters, 32 bits, with their gradients in ``grad``.

    Args:
        module: Its parameters and gradients become views.
        precision: Of products: 32-bit floats, or bfloat16 with 32-bit parameters behind.
    """

    def __init__(self, module: nn.Module, precision: torch.dtype = torch.float32) -> None:
        parameters = list(module.parameters())
        self.vector = nn.Parameter(torch.cat([parameter.detach().reshape(-1) for parameter in parameters]))
        self.vector.grad = torch.zeros_like(self.vector)
        self._rounded = self.vector.data.to(precision)  # the vector itself in 32 bits
        sizes = [parameter.numel() for parameter in parameters]
        vectors = (self.vector.data, self.vector.grad, self._rounded)
        self._of_products: dict[int, Tensor] = {}
        for parameter, value, gradient, rounded in zip(parameters, *(v.split(sizes) for v in vectors), strict=True):
            parameter.data = value.view_as(parameter)
            parameter.grad = gradient.view_as(parameter)
            self._of_products[id(parameter)] = rounded.view_as(parameter)

    def layers(self, module: nn.Module) -> list[Layer]:
        """Linear layers of the module or of a part of it, in order."""
        found = []
        for child in module.modules():
            if isinstance(child, nn.Linear):
                assert child.weight.grad is not None
                assert child.bias.grad is not None
                weight, bias = self._of_products[id(child.weight)], self._of_products[id(child.bias)]
                found.append(Layer(weight, bias, child.weight.grad, child.bias.grad))
        return found

    def refresh(self) -> None:
        """Round the parameters anew for the products, after they have changed."""
        if self._rounded.dtype != self.vector.dtype:
            self._rounded.copy_(self.vector.data)


ACTOR, FIRST, SECOND, GRADIENT = range(4)
"""Who holds a buffer of a `Workspace`: hidden layers of the actor, of a critic, of the other one, or gradients."""


class Workspace:
    """Buffers for passes through ReLU perceptrons: products are written where the cache still holds the memory."""

    def __init__(self, precision: torch.dtype = torch.float32) -> None:
        self.precision = precision
        self._buffers: dict[tuple[int, ...], Tensor] = {}

    def buffer(self, holder: int, index: int, rows: int, width: int) -> Tensor:
        """The buffer of a holder's layer, shape (rows, width), with whatever was written to it last."""
        key = (holder, index, rows, width)
        if key not in self._buffers:
            self._buffers[key] = torch.empty(rows, width, dtype=self.precision)
        return self._buffers[key]

    def forward(self, layers: list[Layer], x: Tensor, holder: int) -> list[Tensor]:
        """Activations of a perceptron: input, hidden layers after ReLU, linear output in 32 bits.

        The holder's next pass overwrites the hidden layers.
        """
        activations = [x.to(self.precision)]
        for index, layer in enumerate(layers[:-1]):
            out = self.buffer(holder, index, len(x), len(layer.bias))
            torch.addmm(layer.bias, activations[-1], layer.weight.t(), out=out)
            activations.append(out.relu_())
        activations.append(torch.addmm(layers[-1].bias, activations[-1], layers[-1].weight.t()).float())
        return activations

    def backward(
        self, layers: list[Layer], activations: list[Tensor], gradient: Tensor, weights: bool, inputs: bool
    ) -> Tensor | None:
        """Propagate the gradient of the output; write gradients of the weights, return that of the input, if wanted."""
        gradient = gradient.to(self.precision)
        for index in range(len(layers) - 1, -1, -1):
            layer, before = layers[index], activations[index]
            if weights:
                write_gradient(layer, gradient, before)
            if index == 0:
                return torch.mm(gradient, layer.weight).float() if inputs else None
            out = self.buffer(GRADIENT, index % 2, len(before), layer.weight.shape[1])
            gradient = through_relu(torch.mm(gradient, layer.weight, out=out), before)
        return None


def through_relu(gradient: Tensor, output: Tensor) -> Tensor:
    """The gradient, in place, where the output of the ReLU is positive; else 0."""
    torch.ops.aten.threshold_backward.grad_input(gradient, output, 0.0, grad_input=gradient)
    return gradient


def write_gradient(layer: Layer, gradient: Tensor, before: Tensor) -> None:
    """Gradients of a layer's weight and bias from that of its output and from its input."""
    if gradient.dtype == torch.float32:
        torch.mm(gradient.t(), before, out=layer.weight_gradient)
    else:
        layer.weight_gradient.copy_(torch.mm(gradient.t(), before))
    torch.sum(gradient, 0, dtype=torch.float32, out=layer.bias_gradient)
