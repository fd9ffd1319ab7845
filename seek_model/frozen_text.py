"""What CLIP's and MiniLM's readers share: they never train, and read each instruction once."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from seek_model.trunk import Words

ROOM = 1 << 20  # bytes; CLIP's merges are 0.53 MB, MiniLM's tokenizer is 0.47 MB
MOST = 512  # instructions that are kept, read; CLIP's take 158 kB each


class FrozenText(nn.Module):
    """Reads instructions with weights that never train.

    The file that its tokenizer is made of is a tensor among the others, so that a checkpoint needs
    no other file. Made without files it takes such a checkpoint, and reads nothing before.
    """

    channels: int  # of a word
    most: int  # words of an instruction; the others are cut off

    def __init__(self) -> None:
        super().__init__()
        self.source: Tensor
        self.register_buffer("source", torch.zeros(ROOM, dtype=torch.uint8))
        self._kept: dict[str, Words] = {}
        self._stamp: tuple[object, ...] = ()

    @torch.no_grad()
    def forward(self, instructions: Sequence[str]) -> Words:
        """Words of the instructions, `most` long.

        Raises:
            ValueError: it was made without files, and no checkpoint was loaded since.
        """
        self._take_changes()
        fresh = [text for text in dict.fromkeys(instructions) if text not in self._kept]
        if fresh:
            # Precision and mode must not depend on who asked first.
            device = self.source.device.type
            with torch.inference_mode(False), torch.autocast(device, enabled=False):
                read = self.read(fresh)
            for text, *parts in zip(fresh, *read, strict=True):
                self._kept[text] = Words(*parts)
        rows = [self._kept[text] for text in instructions]
        return Words(*(torch.stack(part) for part in zip(*rows, strict=True)))

    def read(self, instructions: list[str]) -> Words:
        """Words of instructions that differ from each other."""
        raise NotImplementedError

    def make_tokenizer(self, source: bytes) -> None:
        """Take the tokenizer from its file, or, if that is empty, say what is missing."""
        raise NotImplementedError

    def keep_source(self, file: bytes) -> None:
        """Put the tokenizer's file among the tensors, and take the tokenizer from it."""
        if len(file) > ROOM:
            raise ValueError(f"the tokenizer's file has {len(file)} bytes; at most {ROOM} fit")
        self.source[: len(file)] = torch.frombuffer(bytearray(file), dtype=torch.uint8)
        self._take_changes()

    def _take_changes(self) -> None:
        # Tensors are also filled one by one, without a hook that could be waited for.
        stamp = (self.source.device, self.source.data_ptr(), self.source._version)
        if stamp != self._stamp:
            self._kept.clear()
            self.make_tokenizer(self.source.cpu().numpy().tobytes().rstrip(b"\0"))
            self._stamp = stamp
        if len(self._kept) > MOST:
            self._kept.clear()
