"""``python -m bench``."""

from bench.cli import main

if __name__ == "__main__":
    try:
        main()
    finally:
        # CPython notes an interrupt that leaves an exec(), as of a dataclass in an import, as one that nobody caught,
        # and python -m then dies of it (status -2) whatever exit code is asked for. The next exec() takes that back.
        exec("")
