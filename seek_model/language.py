"""The small reader of instructions, trained with the policy.

Benchmarks speak in few words; what matters is that colours, counts and sides stay apart, which
pooled sentence embeddings do badly (models.md 3). Every word is a row of a table: known words have
their own, others share a few rows by hash.
"""

import re
import zlib
from collections.abc import Sequence
from functools import lru_cache

import torch
from torch import Tensor, nn

from seek_model.config import Language
from seek_model.trunk import Words

_NUMBERS = "zero one two three four five six seven eight nine ten eleven twelve"
_OTHERS = """
a above after again all an and any are as at azure back base before beside big black blocks block
blue book bottom box boxes brown bulb button by cabinet channel change check close color container
cup cups cyan desk dirt down drawer empty exactly first from front gray green grey grip hidden in
inside into item it its jar left lid lift light lime liquid magenta maroon middle minus navy new no
object of off olive on once open opened orange order original other out over peg pegs pink place
placed plus pour press purple push put red region remaining remote reopen return right ring rose
rubbish same scale search second shut side silver slide sponge square stack start state swap table
take tan target teal that the then they third time times to top tower turn up violet wait weigh
white wipe with yellow
"""
NUMBERS = _NUMBERS.split()
KNOWN = [*NUMBERS, *_OTHERS.split()]
SHARED = 32  # rows for all other words
_ROW = {word: 1 + row for row, word in enumerate(dict.fromkeys(KNOWN))}  # row 0: no word


@lru_cache(maxsize=4096)
def rows_of(instruction: str, tokens: int) -> tuple[int, ...]:
    """The table's rows of an instruction's first words; digits are number words."""
    words = re.findall(r"[a-z]+|\d+", instruction.lower())[:tokens]
    return tuple(_row(NUMBERS[int(w)] if w.isdecimal() and int(w) <= 12 else w) for w in words)


def _row(word: str) -> int:
    return _ROW.get(word) or 1 + len(_ROW) + zlib.crc32(word.encode()) % SHARED


class WordReader(nn.Module):
    """Instructions to words (e l d), by a recurrent net that reads both ways."""

    def __init__(self, config: Language):
        super().__init__()
        self.channels, self.most = config.channels, config.tokens
        self.table = nn.Embedding(1 + len(_ROW) + SHARED, config.channels, padding_idx=0)
        self.reader = nn.GRU(
            config.channels, config.channels // 2, batch_first=True, bidirectional=True
        )
        self.pool = nn.Sequential(
            nn.Linear(2 * config.channels, config.channels), nn.GELU(),
            nn.Linear(config.channels, config.channels), nn.LayerNorm(config.channels),
        )  # fmt: skip

    def forward(self, instructions: Sequence[str]) -> Words:
        """Words of the instructions; equal instructions are read once."""
        distinct = list(dict.fromkeys(instructions))
        read = self._read([rows_of(text, self.most) for text in distinct])
        of = torch.tensor([distinct.index(text) for text in instructions], device=read.mask.device)
        return Words(*(part[of] for part in read))

    def _read(self, sentences: list[tuple[int, ...]]) -> Words:
        rows = torch.zeros(len(sentences), self.most, dtype=torch.long)
        for number, sentence in enumerate(sentences):
            rows[number, : len(sentence)] = torch.tensor(sentence, dtype=torch.long)
        rows = rows.to(self.table.weight.device)
        mask = rows > 0
        embedded = self.table(rows)
        tokens = embedded + self._in_context(embedded, mask)
        tokens = tokens * mask[..., None]
        mean = tokens.sum(dim=1) / mask.sum(dim=1, keepdim=True).clamp(min=1)
        # A maximum keeps the one word that differs; a mean over the sentence thins it out.
        most = tokens.masked_fill(~mask[..., None], -1e4).amax(dim=1)
        return Words(tokens, mask, self.pool(torch.cat([mean, most], dim=-1)))

    def _in_context(self, embedded: Tensor, mask: Tensor) -> Tensor:
        lengths = mask.sum(dim=1).clamp(min=1).cpu()
        packed = nn.utils.rnn.pack_padded_sequence(
            embedded, lengths, batch_first=True, enforce_sorted=False
        )
        unpacked, _ = nn.utils.rnn.pad_packed_sequence(
            self.reader(packed)[0], batch_first=True, total_length=self.most
        )
        return unpacked
