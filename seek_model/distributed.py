"""One training on several devices, started by torchrun; alone it is a group of one.

The first process (rank 0) is the only one that writes. A batch is split over the ranks.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import NamedTuple

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

PATIENCE = timedelta(hours=1)  # the first validates and writes while the others wait


class Group(NamedTuple):
    """The processes that train together, as one of them sees it."""

    rank: int
    world: int
    device: torch.device

    @property
    def first(self) -> bool:
        """Whether this process writes."""
        return self.rank == 0

    def parallel(self, network: nn.Module, *, unused: bool) -> nn.Module:
        """The network as it is called in training: gradients become the group's mean.

        Statistics of batches stay those of each process.

        Args:
            network: the same in every process.
            unused: whether an update may leave a parameter without a gradient.
        """
        if self.world == 1:
            return network
        return DistributedDataParallel(
            network, find_unused_parameters=unused, forward_sync_buffers=False
        )

    def wait(self) -> None:
        """Until all are here."""
        if self.world > 1:
            distributed.barrier()

    def mean(self, values: Tensor) -> Tensor:
        """The mean over the group, elementwise; the same in every process."""
        if self.world > 1:
            distributed.all_reduce(values)
        return values / self.world


@contextmanager
def joined() -> Iterator[Group]:
    """The group that torchrun started this process in; without torchrun a group of one."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    device = _device()
    if world == 1:
        yield Group(0, 1, device)
        return
    backend = "nccl" if device.type == "cuda" else "gloo"
    distributed.init_process_group(backend, timeout=PATIENCE)
    try:
        yield Group(distributed.get_rank(), world, device)
    finally:
        distributed.destroy_process_group()


def _device() -> torch.device:
    if not torch.cuda.is_available():
        return torch.device("cpu")
    device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
    torch.cuda.set_device(device)
    return device
