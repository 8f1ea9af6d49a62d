"""What every run needs, imported once by the process that workers are forked from.

What cannot be imported here fails, with its reason, the runs that need it.
"""

import atexit
import contextlib
import gc
import os
import sys

from bench.fork_server import PARENT

_PARENT = int(os.environ.get(PARENT, os.getppid()))  # by name: it may have ended by now


class _Orphan:
    """Looks, at every import, whether the command is still there: after a mistyped name it is not, soon."""

    @staticmethod
    def find_spec(*_: object) -> None:
        """End this process when its parent has: whoever reads what the command prints would wait for it."""
        if os.getppid() != _PARENT:
            os._exit(0)


gc.disable()  # what imports make stays: to look for garbage in it took a quarter of their time
sys.meta_path.insert(0, _Orphan)
with contextlib.suppress(Exception):
    from bench import runner, tracking  # noqa: F401
with contextlib.suppress(Exception):
    import algorithms.sac_training  # noqa: F401
sys.meta_path.remove(_Orphan)
gc.freeze()  # nor do workers look through it, which would copy its memory
gc.enable()
# Whoever reads what the command prints waits for this process, too; taking down torch would take 0.7 s.
atexit.register(os._exit, 0)
