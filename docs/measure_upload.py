"""Measures an upload: bytes a second, and the server's memory while it comes and is looked at.

Run it with: .venv/bin/python docs/measure_upload.py [MEGABYTES [ROUNDS]]
What is sent is no model, so it is refused once it is there; the refusal is timed too.
"""

import os
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from safetensors.numpy import save_file

from server.client import Client, ServerProblem
from server.client_uploads import PIECE
from tests.server.running import RunningServer
from workers.simulator_process import descendants

MB = 10**6


def made(file: Path, megabytes: int, seed: int) -> Path:
    """A file of tensors, no two alike."""
    dice = np.random.default_rng(seed)
    parts = {f"part.{n}": dice.bytes(100 * MB) for n in range(megabytes // 100)}
    save_file({name: np.frombuffer(part, np.float32) for name, part in parts.items()}, file)
    return file


def peak(pid: int) -> float:
    """The most memory that a process has had, in MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) * 1024 / MB
    return 0.0


def copied(source: Path, target: Path) -> float:
    """Seconds that a copy with hash takes here, for comparison: read, hash, write, flush."""
    import hashlib

    began, digest = time.perf_counter(), hashlib.sha256()
    with source.open("rb") as there, target.open("wb") as here:
        while piece := there.read(PIECE):
            digest.update(piece)
            here.write(piece)
        here.flush()
        os.fsync(here.fileno())
    target.unlink()
    return time.perf_counter() - began


def refused_after(url: str, file: Path, name: str) -> tuple[float, float]:
    """Seconds until all of it had come, and from then until the server had refused it."""
    times: list[float] = []
    with Client(url) as client:
        try:
            client.upload(file, name, told=lambda *_: times.append(time.perf_counter()))
        except ServerProblem as error:
            print(f"  refused: {str(error)[:90]}")
    return times[-1] - times[0], time.perf_counter() - times[-1]


def main(megabytes: int = 2000, rounds: int = 3) -> None:
    """Prints medians over some rounds."""
    sent, looked, plain = [], [], []
    with TemporaryDirectory(prefix="hide-upload-") as temporary:
        folder = Path(temporary)
        with RunningServer(folder / "data", "--no-references", workers=1) as server:
            pid = server.process.pid
            print(f"server's peak memory before: {peak(pid):.0f} MB")
            for number in range(rounds):
                file = made(folder / "big.safetensors", megabytes, number)
                size = file.stat().st_size / MB
                plain.append(size / copied(file, folder / "copy"))
                came, refused = refused_after(server.url, file, f"big-{number}")
                sent.append(size / came)
                looked.append(refused)
                print(f"  {sent[-1]:.0f} MB/s, looked at in {refused:.1f} s", flush=True)
                for upload in server.get("/uploads"):
                    server.client.delete(
                        f"/api/v1/uploads/{upload['id']}", headers={"Tus-Resumable": "1.0.0"}
                    )
            print(f"server's peak memory after: {peak(pid):.0f} MB")
            print("of its processes: ", [round(peak(one)) for one in descendants(pid)])
    print(f"{median(sent):.0f} MB/s; a copy on this disk with hash and flush: {median(plain):.0f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
