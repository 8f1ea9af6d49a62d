"""The stand-in for torch's compiler: an optimiser steps without it, and whoever wants it gets it."""

import subprocess
import sys

BEGIN = """
import sys, torch
from algorithms.compiler_left_out import leave_compiler_out

leave_compiler_out()
weight = torch.nn.Parameter(torch.ones(3))
optimiser = torch.optim.Adam([weight], lr=0.1)
weight.grad = torch.ones(3)
optimiser.step()
optimiser.load_state_dict(optimiser.state_dict())
assert torch.allclose(weight, torch.full((3,), 0.9)), weight
assert not any(name.startswith("torch._dynamo.") for name in sys.modules)
"""


def succeeds(script):
    done = subprocess.run([sys.executable, "-c", BEGIN + script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_optimiser_steps_without_the_compiler():
    succeeds("")


def test_what_looks_through_all_modules_does_not_import_the_compiler():
    succeeds("""
assert not any(hasattr(module, "__file__") for name, module in sys.modules.items() if name == "torch._dynamo")
assert not any(name.startswith("torch._dynamo.") for name in sys.modules)
""")


def test_whoever_compiles_gets_the_compiler():
    succeeds("""
doubled = torch.compile(lambda x: 2.0 * x, backend="eager")
assert doubled(torch.ones(2)).tolist() == [2.0, 2.0]
import torch._dynamo.config
assert "disable" in vars(torch._dynamo)
""")


def test_a_compiler_that_is_there_stays():
    succeeds("""
import torch._dynamo.config
before = sys.modules["torch._dynamo"]
leave_compiler_out()
assert sys.modules["torch._dynamo"] is before is torch._dynamo
""")
