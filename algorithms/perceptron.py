"""Passes through ReLU perceptrons written out by hand: forward, backward, parameters as one vector."""

from __future__ import annotations

import torch
from torch import Tensor, nn


def linear_layers(module: nn.Module) -> list[nn.Linear]:
    """Linear layers of a module, in order."""
    return [child for child in module.modules() if isinstance(child, nn.Linear)]


ACTOR, FIRST, SECOND, GRADIENT = range(4)
"""Who holds a buffer of a `Workspace`: hidden layers of the actor, of a critic, of the other one, or gradients."""


class Workspace:
    """Buffers for passes through ReLU perceptrons: products are written where the cache still holds the memory."""

    def __init__(self) -> None:
        self._buffers: dict[tuple[int, ...], Tensor] = {}

    def buffer(self, holder: int, index: int, rows: int, width: int) -> Tensor:
        """The buffer of a holder's layer, shape (rows, width), with whatever was written to it last."""
        key = (holder, index, rows, width)
        if key not in self._buffers:
            self._buffers[key] = torch.empty(rows, width)
        return self._buffers[key]

    def forward(self, layers: list[nn.Linear], x: Tensor, holder: int) -> list[Tensor]:
        """Activations of a perceptron: input, hidden layers after ReLU, linear output.

        The holder's next pass overwrites the hidden layers.
        """
        activations = [x]
        for index, layer in enumerate(layers[:-1]):
            out = self.buffer(holder, index, len(x), layer.out_features)
            torch.addmm(layer.bias, activations[-1], layer.weight.t(), out=out)
            activations.append(out.relu_())
        activations.append(torch.addmm(layers[-1].bias, activations[-1], layers[-1].weight.t()))
        return activations

    def backward(
        self, layers: list[nn.Linear], activations: list[Tensor], gradient: Tensor, weights: bool, inputs: bool
    ) -> Tensor | None:
        """Propagate the gradient of the output; write ``.grad`` of the weights, return that of the input, if wanted."""
        for index in range(len(layers) - 1, -1, -1):
            layer, before = layers[index], activations[index]
            if weights:
                write_gradient(layer, gradient, before)
            if index == 0:
                return torch.mm(gradient, layer.weight) if inputs else None
            out = self.buffer(GRADIENT, index % 2, len(before), layer.in_features)
            gradient = through_relu(torch.mm(gradient, layer.weight, out=out), before)
        return None


def through_relu(gradient: Tensor, output: Tensor) -> Tensor:
    """The gradient, in place, where the output of the ReLU is positive; else 0."""
    torch.ops.aten.threshold_backward.grad_input(gradient, output, 0.0, grad_input=gradient)
    return gradient


def write_gradient(layer: nn.Linear, gradient: Tensor, before: Tensor) -> None:
    """Gradients of a layer's weight and bias from that of its output and from its input."""
    assert layer.weight.grad is not None
    assert layer.bias.grad is not None
    torch.mm(gradient.t(), before, out=layer.weight.grad)
    torch.sum(gradient, 0, out=layer.bias.grad)


def flatten(module: nn.Module) -> nn.Parameter:
    """One parameter that holds all of a module's, values and gradients: the module keeps views into it.

    Adam works element by element; over one long vector it has no per-parameter work.
    """
    parameters = list(module.parameters())
    flat = nn.Parameter(torch.cat([parameter.detach().reshape(-1) for parameter in parameters]))
    flat.grad = torch.zeros_like(flat)
    sizes = [parameter.numel() for parameter in parameters]
    for parameter, value, gradient in zip(parameters, flat.data.split(sizes), flat.grad.split(sizes), strict=True):
        parameter.data = value.view_as(parameter)
        parameter.grad = gradient.view_as(parameter)
    return flat
