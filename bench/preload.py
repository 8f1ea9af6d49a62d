"""What every run needs, imported once by the process that workers are forked from.

What cannot be imported here fails, with its reason, the runs that need it.
"""

import contextlib

with contextlib.suppress(Exception):
    from bench import runner, tracking  # noqa: F401
with contextlib.suppress(Exception):
    import algorithms.sac  # noqa: F401
