from collections.abc import Sequence

__version__: str

def main(argv: Sequence[str]) -> int:
    """Runs the command line `argv`, the program's name first. Prints as the command does; gives its exit status.

    Once per process, and from its main thread: it takes over SIGINT and SIGTERM.
    """
