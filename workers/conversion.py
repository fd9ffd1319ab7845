"""Files of torch.save made checkpoints, each in a process of its own that is closed."""

from pathlib import Path

from hide_tasks.contract import PolicyFailure
from workers.policies import MISMATCH, BadPolicy, Surroundings
from workers.policy_host import CHECKPOINT
from workers.policy_process import LOAD_LIMIT, NotStarted, PolicyProcess

PIECE = 8 * 2**20  # bytes of an answer
PIECE_LIMIT = 60.0  # s


class _Converting(PolicyProcess):
    """Plays nothing: it is asked for the checkpoint in its file."""

    def begin(self, path: Path, limit: float) -> int:
        """How many bytes the checkpoint has."""
        self.make_ready()
        return int(self._ask({"convert": str(path)}, limit)["size"])

    def piece(self, start: int) -> bytes:
        """The next bytes of it."""
        return bytes(self._ask({"piece": [start, start + PIECE]}, PIECE_LIMIT)["piece"])


def convert(
    saved: Path, into: Path, surroundings: Surroundings, *, most: int, limit: float = LOAD_LIMIT
) -> None:
    """Writes the checkpoint that a file of torch.save holds.

    Args:
        saved: the file.
        into: a file that is not there yet; nothing is left there if this fails.
        surroundings: of the process.
        most: bytes that the checkpoint may have.
        limit: seconds for reading the file.

    Raises:
        BadPolicy: it holds none, and why.
    """
    process = _Converting(
        f"{CHECKPOINT}{saved.absolute()}",
        timeout=surroundings.timeout,
        threads=surroundings.threads,
        sandbox=surroundings.sandbox,
    )
    try:
        size = process.begin(saved.absolute(), limit)
        if size > most:
            raise BadPolicy(f"its checkpoint would have {size} bytes; at most {most} are taken")
        _write(process, into, size)
    except (PolicyFailure, NotStarted) as error:
        raise BadPolicy(str(error).removeprefix(MISMATCH)) from None
    finally:
        process.close()


def _write(process: _Converting, into: Path, size: int) -> None:
    try:
        with into.open("xb") as file:
            while file.tell() < size:
                piece = process.piece(file.tell())
                if not 0 < len(piece) <= size - file.tell():
                    raise BadPolicy(f"it was cut at {file.tell()} of {size} bytes")
                file.write(piece)
    except BaseException:
        into.unlink(missing_ok=True)
        raise
