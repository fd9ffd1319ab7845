"""The trained checkpoints that come with this code, by name; looked at without torch.

Each is NAME.safetensors in this folder, in half precision, as `python -m docs.ship` writes it. Any
of them may be missing. Its header says how it was made: configuration and provenance.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from seek_model.checkpoint_header import Header, read_header

FOLDER = Path(__file__).resolve().parent
MOST = 25_000_000  # bytes of one of them
SUFFIX = ".safetensors"
ABOUT = {  # of those that are policies to evaluate by name
    "seek-small": "SEEK at small size, trained with this code; it comes along.",
    "sam2act-small": "The memory-free twin of seek-small: the same network without memory.",
}
POLICIES = tuple(ABOUT)
STAGE_ONE = "stage-one"  # what both were trained on from
NAMES = (*POLICIES, STAGE_ONE)


@dataclass(frozen=True)
class Trained:
    """A checkpoint that is there."""

    name: str
    path: Path
    sha256: str
    size: int  # bytes
    header: Header


def path_of(name: str, folder: Path = FOLDER) -> Path:
    """Where a checkpoint is, or would be."""
    return folder / f"{name}{SUFFIX}"


def there(folder: Path = FOLDER) -> list[str]:
    """Names of the policies whose file is in the folder."""
    return [name for name in POLICIES if path_of(name, folder).is_file()]


def read(name: str, folder: Path = FOLDER) -> Trained:
    """What a checkpoint is; none of its weights is loaded.

    Raises:
        BadCheckpoint: the file is damaged.
        OSError: it is not there, or cannot be read.
    """
    path = path_of(name, folder)
    content = path.read_bytes()
    return Trained(
        name, path, hashlib.sha256(content).hexdigest(), len(content), read_header(content)
    )
