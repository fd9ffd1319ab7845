import itertools

import pytest
import torch

from hide_tasks import ALL_TASKS, load, suite
from seek_model.config import Language
from seek_model.language import WordReader, rows_of

TOKENS = Language().tokens


def reader() -> WordReader:
    torch.manual_seed(0)
    return WordReader(Language(channels=16))


def test_digits_are_number_words() -> None:
    assert rows_of("push it 3 times", TOKENS) == rows_of("push it three times", TOKENS)
    assert rows_of("push it 3 times", TOKENS) != rows_of("push it 4 times", TOKENS)


def test_case_and_punctuation_do_not_matter() -> None:
    assert rows_of("Push the RED button!", TOKENS) == rows_of("push the red button", TOKENS)


def test_an_unknown_word_has_a_row_and_always_the_same() -> None:
    assert rows_of("zyzzyva", TOKENS) == rows_of("zyzzyva", TOKENS)
    assert max(rows_of("zyzzyva qwxk plonk", TOKENS)) < reader().table.num_embeddings


@pytest.mark.parametrize("task", ALL_TASKS)
def test_every_instruction_of_a_task_reads_differently(task: str) -> None:
    kind = load(task)
    told = sorted({kind.wording(spec.variation) for spec in suite.episodes(task, "train")})

    pooled = reader()(told).pooled

    assert all(len(rows_of(text, 99)) <= TOKENS for text in told)
    for one, other in itertools.combinations(range(len(told)), 2):
        assert (pooled[one] - pooled[other]).abs().max() > 1e-3, (told[one], told[other])


def test_an_instruction_reads_the_same_in_any_company() -> None:
    made = reader().eval()
    texts = ["push the red button 2 times", "open", "push the red button 2 times"]

    together = made(texts)

    for i, text in enumerate(texts):
        alone = made([text])
        assert torch.allclose(together.pooled[i], alone.pooled[0], atol=1e-6)
        assert torch.allclose(together.tokens[i], alone.tokens[0], atol=1e-6)
        assert torch.equal(together.mask[i], alone.mask[0])


def test_an_empty_instruction_reads_finite() -> None:
    assert torch.isfinite(reader()([""]).pooled).all()
