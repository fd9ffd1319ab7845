"""Puts a trained checkpoint among those that come with the code, in half precision.

.venv/bin/python -m docs.ship RUN/checkpoint.safetensors NAME        # NAME as in seek_model/trained
"""

import argparse
import difflib
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from safetensors.torch import load_file
from torch import Tensor

from seek_model import checkpoint, policy, trained
from seek_model.checkpoint_header import BadCheckpoint, Header, read_header
from seek_model.conversion import in_order
from seek_model.trained import FOLDER, MOST, NAMES, STAGE_ONE, Trained

ENDING = ".whole"  # of a file that is not checked yet


class CannotShip(ValueError):
    """The checkpoint does not come with the code; nothing was changed."""


class Moved(NamedTuple):
    """The weight that half precision moved furthest."""

    tensor: str
    before: float
    after: float


def ship(source: Path, name: str, folder: Path = FOLDER) -> tuple[Trained, Moved]:
    """Writes NAME.safetensors into a folder, with the configuration and provenance of the source.

    Raises:
        CannotShip: there is no such name, or the file does not load, is not what goes by that
            name, holds what is too large for float16, or would be too large itself.
    """
    header = _fitting(source, name)
    whole = load_file(source)
    try:
        halved = checkpoint.halved(whole)
    except ValueError as error:
        raise CannotShip(f"{source}: {error}") from None
    target = trained.path_of(name, folder)
    unchecked = target.with_name(target.name + ENDING)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        checkpoint.save(unchecked, halved, header.config, header.provenance)
        unchecked.write_bytes(in_order(unchecked.read_bytes()))  # the same weights, the same file
        if (size := unchecked.stat().st_size) > MOST:
            raise CannotShip(f"{source} takes {size} bytes in half precision; at most {MOST} may.")
        policy.load(unchecked)
        os.replace(unchecked, target)
    finally:
        unchecked.unlink(missing_ok=True)
    return trained.read(name, folder), _moved_furthest(whole, halved)


def _fitting(source: Path, name: str) -> Header:
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise CannotShip(f"Nothing of the name '{name}' comes along.{hint} {', '.join(NAMES)} do.")
    try:
        policy.load(source)
        header = read_header(source)
    except (BadCheckpoint, OSError) as error:
        raise CannotShip(f"{source} is no checkpoint that plays: {error}") from None
    remembers, memory = name == "seek-small", header.config.model.memory
    if remembers != (memory is not None):
        wanted, found = ("a", "none") if remembers else ("no", "one")
        raise CannotShip(f"{name} is a policy with {wanted} memory; {source} has {found}.")
    if name == STAGE_ONE and header.provenance.phase != "first":
        raise CannotShip(f"{name} is what the first phase gave; {source} is from the second.")
    return header


def _moved_furthest(whole: Mapping[str, Tensor], halved: Mapping[str, Tensor]) -> Moved:
    furthest, found = -1.0, Moved("", 0.0, 0.0)
    for name, tensor in whole.items():
        if not tensor.is_floating_point() or not tensor.numel():
            continue
        before, after = tensor.flatten().double(), halved[name].flatten().double()
        at = int((before - after).abs().argmax())
        if (moved := abs(float(before[at] - after[at]))) > furthest:
            furthest, found = moved, Moved(name, float(before[at]), float(after[at]))
    return found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="docs.ship", description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("name", help=", ".join(NAMES))
    parser.add_argument("--to", type=Path, default=FOLDER, help="another folder")
    given = parser.parse_args(arguments)
    try:
        one, moved = ship(given.checkpoint, given.name, given.to)
    except CannotShip as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{one.path}: {one.size} bytes, SHA-256 {one.sha256}")
    print(f"{one.header.config.name}, {one.header.parameters} numbers; {one.header.provenance}")
    print(f"moved furthest: {moved.tensor}, from {moved.before:.9g} to {moved.after:.9g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
