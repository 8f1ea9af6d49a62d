"""What every run needs, imported once by the process that workers are forked from.

What cannot be imported here fails, with its reason, the runs that need it.
"""

import contextlib
import os
import sys

_PARENT = os.getppid()


class _Orphan:
    """Looks, at every import, whether the command is still there: after a mistyped name it is not, soon."""

    @staticmethod
    def find_spec(*_: object) -> None:
        """End this process when its parent has: whoever reads what the command prints would wait for it."""
        if os.getppid() != _PARENT:
            os._exit(0)


sys.meta_path.insert(0, _Orphan)
with contextlib.suppress(Exception):
    from bench import runner, tracking  # noqa: F401
with contextlib.suppress(Exception):
    import algorithms.sac  # noqa: F401
sys.meta_path.remove(_Orphan)
