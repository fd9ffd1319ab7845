"""Measures SEEK: samples a second, decision latency, memory reads, sizes.

Run it with: .venv/bin/python docs/measure_seek.py [ROUNDS] [--paper]
It takes about three minutes, with --paper ten; the machine should have nothing else to do. Figures
are medians over rounds; within a round everything is measured once, so that a slow minute hits all.
"""

import resource
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

import torch

sys.path.insert(0, str(Path(__file__).parents[1]))

from seek_model import losses
from seek_model.config import Config
from seek_model.memory import Archive, write
from seek_model.network import Network, parameter_counts
from seek_model.presets import MODELS, preset
from tests.seek_model.tiny import frames, targets

POINTS = 29_000  # of a frame, as stores of the small presets have
ARCHIVES = (10, 100, 10_000)


def training(config: Config, *, steps: int, batch: int, precision: str) -> Callable[[], float]:
    """Samples a second of updates: forward, backward, step; clouds are there already."""
    torch.manual_seed(0)
    net = Network(config.model)
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-4)
    seen = frames(batch, steps, points=POINTS)
    wanted = targets(seen)

    def one() -> float:
        began = time.perf_counter()
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bf16"):
            said = net(seen, wanted)
        optimizer.zero_grad()
        phase = config.train.first if steps == 1 else config.train.second
        losses.total(said, wanted, net, config.train, phase)["total"].backward()
        optimizer.step()
        return batch * steps / (time.perf_counter() - began)

    return one


def decision(config: Config) -> Callable[[], float]:
    """Seconds of one decision with a full window and an anchor, without making the cloud."""
    torch.manual_seed(0)
    net = Network(config.model).eval()
    seen = frames(1, 1, points=POINTS if "small" in config.name else 65_536)
    archives = net.begin(1)
    for _ in range(9 if config.model.memory else 0):
        _, pending = net.play(seen, archives)
        assert pending
        pending.commit()

    def one() -> float:
        began = time.perf_counter()
        net.play(seen, archives)
        return time.perf_counter() - began

    return one


def reading(config: Config, entries: int) -> Callable[[], float]:
    """Milliseconds of one read of an archive: key search, slots and attention."""
    torch.manual_seed(0)
    net = Network(config.model).eval()
    memory, trunk = net.coarse.memory, net.coarse.trunk
    assert memory
    shape = memory._empty
    archive, tokens = Archive(), torch.randn(shape)
    for i in range(entries):
        write(archive, i, torch.randn(shape[0] * trunk.channels), tokens)
    features = torch.randn(1, shape[0], trunk.channels, trunk.cells, trunk.cells)
    key = torch.randn(1, shape[0] * trunk.channels)

    @torch.no_grad()
    def one() -> float:
        began = time.perf_counter()
        slots = memory.episodes.read([archive], key, torch.zeros(shape))
        memory.attention(features, slots)
        return 1000 * (time.perf_counter() - began)

    return one


def sizes() -> None:
    """Parameters of every preset, in millions; readers of instructions apart."""
    for name in MODELS:
        found = parameter_counts(preset(name).model)
        counts = {part: count / 1e6 for part, count in found.items()}
        reader = counts.pop("language")
        line = ", ".join(f"{part} {count:.2f}" for part, count in counts.items())
        print(f"{name:20} {sum(counts.values()):7.2f} M ({line}) + reader {reader:.2f} M")


def measures(paper: bool) -> Iterator[tuple[str, Callable[[], float]]]:
    """What is measured, by name and unit."""
    seek, free = preset("seek-small"), preset("sam2act-small")
    for precision in ("bf16", "fp32"):
        once = training(free, steps=1, batch=16, precision=precision)
        yield f"stage 1, {precision}, samples/s", once
        sequences = training(seek, steps=7, batch=8, precision=precision)
        yield f"stage 2, {precision}, frames/s", sequences
    yield "decision, seek-small, s", decision(seek)
    for entries in ARCHIVES:
        yield f"read of {entries} entries, small, ms", reading(seek, entries)
    if paper:
        yield "decision, seek-paper without language, s", decision(_without_clip("seek-paper"))
        for entries in (10, 100):
            yield f"read of {entries} entries, paper, ms", reading(preset("seek-paper"), entries)


def _without_clip(name: str) -> Config:
    """CLIP's file is not part of the package; the small reader takes its place."""
    config, small = preset(name), preset("seek-small").model.language
    return config.model_copy(update={"model": config.model.model_copy(update={"language": small})})


def main() -> None:
    """Prints everything."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdecimal()]
    sizes()
    print(f"threads: {torch.get_num_threads()}")
    found = defaultdict(list)
    what = list(measures("--paper" in sys.argv))
    for _, measure in what:
        measure()  # the first run makes buffers and kernels
    for _ in range(numbers[0] if numbers else 5):
        for name, measure in what:
            found[name].append(measure())
    for name, values in found.items():
        print(f"{name:45} {median(values):9.3f}   ({min(values):.3f} to {max(values):.3f})")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"peak memory: {peak:.1f} GiB")


if __name__ == "__main__":
    main()
