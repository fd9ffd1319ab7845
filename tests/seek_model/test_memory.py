import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from seek_model.config import Memory
from seek_model.memory import Archive, EpisodeMemory, Keys, write

EMPTY = torch.zeros(3, 4, 8)  # v n c


def memory(**changes: object) -> EpisodeMemory:
    torch.manual_seed(0)
    return EpisodeMemory(Memory(channels=8, stages=4).model_copy(update=changes))


def archive(entries: int, keys: Tensor | None = None) -> Archive:
    """An archive whose entry i holds the number i everywhere."""
    made = Archive()
    for i in range(entries):
        key = torch.randn(5) if keys is None else keys[i]
        write(made, i, key, torch.full_like(EMPTY, float(i)))
    return made


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 40), st.integers(0, 7), st.sampled_from(["none", "cosine", "first", "random"])
)
def test_window_and_anchor_are_disjoint_and_older_than_now(
    entries: int, window: int, anchor: str
) -> None:
    slots = memory(window=window, anchor=anchor).read([archive(entries)], torch.randn(1, 5), EMPTY)

    recent = slots.windows[0]
    found = slots.anchors[0]

    assert recent == list(range(max(entries - window, 0), entries))
    assert (found is not None) == (anchor != "none" and entries > window)
    if found:
        assert found.entry.decision not in recent
        assert 0 <= found.entry.decision < entries


@pytest.mark.parametrize("entries", [0, 1, 3, 6, 7, 50, 300])
def test_the_read_budget_is_the_same_whatever_the_archives_length(entries: int) -> None:
    slots = memory().read([archive(entries)], torch.randn(1, 5), EMPTY)

    assert slots.tokens.shape == (1, 3, 7, 4, 8)
    assert slots.present.sum() == min(entries, 6) + (entries > 6)


def test_the_window_is_read_latest_first_and_the_anchor_last() -> None:
    keys = torch.eye(5)

    slots = memory(window=2).read([archive(5, keys)], keys[1][None], EMPTY)

    assert slots.tokens[0, 0, :, 0, 0].tolist() == [4.0, 3.0, 1.0]


def test_the_anchor_is_the_most_similar_of_the_entries_that_left_the_window() -> None:
    keys = torch.tensor([[1.0, 0.0], [0.6, 0.8], [0.0, 1.0], [1.0, 0.0]])
    now = torch.tensor([[0.0, 2.0]])  # most like entry 2, which is still in the window

    slots = memory(window=2).read([archive(4, keys)], now, EMPTY)

    anchor = slots.anchors[0]
    assert anchor and anchor.entry.decision == 1
    assert anchor.similarity == pytest.approx(0.8)


def test_of_equally_similar_entries_the_earliest_is_the_anchor() -> None:
    keys = torch.tensor([[0.0, 1.0], [1.0, 0.0], [1.0 - 1e-8, 0.0], [1.0, 0.0]])

    slots = memory(window=0).read([archive(4, keys)], torch.tensor([[1.0, 0.0]]), EMPTY)

    assert slots.anchors[0] and slots.anchors[0].entry.decision == 1


def test_an_oracle_looks_back_where_it_is_told_and_nowhere_else() -> None:
    made = memory(window=2, anchor="oracle")
    archives = [archive(6), archive(6), archive(6)]

    slots = made.read(archives, torch.randn(3, 5), EMPTY, evidence=[3, -1, 5])

    found = [anchor and anchor.entry.decision for anchor in slots.anchors]
    assert found == [3, None, None]  # 5 is in the window


def test_a_random_anchor_is_the_same_for_the_same_seed() -> None:
    made = memory(window=0, anchor="random")

    def drawn(seed: int) -> list[int | None]:
        archives = [archive(n) for n in range(1, 20)]
        for one in archives:
            one.seed = seed
        anchors = made.read(archives, torch.randn(19, 5), EMPTY).anchors
        return [anchor and anchor.entry.decision for anchor in anchors]

    assert drawn(1) == drawn(1)
    assert drawn(1) != drawn(2)


def test_centred_keys_tell_apart_what_a_large_common_part_hides() -> None:
    common = torch.tensor([100.0, 0.0, 0.0])
    keys = Keys()
    keys.append(common + torch.tensor([0.0, 1.0, 0.0]))
    keys.append(common + torch.tensor([0.0, 0.0, 1.0]))
    now = common + torch.tensor([0.0, 1.0, 0.1])

    plain, centred = (keys.similarity(now, 2, center) for center in (False, True))

    assert float(plain[0] - plain[1]) < 1e-3
    assert float(centred[0] - centred[1]) > 1


def test_keys_survive_the_growth_of_their_buffer() -> None:
    rows = torch.randn(70, 4)
    keys = Keys()
    for row in rows:
        keys.append(row)

    assert all(keys.similarity(row, 70, False).argmax() == i for i, row in enumerate(rows))


def test_the_counter_saturates_at_its_last_stage() -> None:
    made = memory()

    stages = made.read([Archive(done=n) for n in (0, 3, 9)], torch.randn(3, 5), EMPTY).stage

    assert not torch.equal(stages[0], stages[1])
    assert torch.equal(stages[1], stages[2])


def test_parts_that_are_off_are_not_built() -> None:
    off = memory(window=3, anchor="none", stages=0)

    assert off.anchor is None
    assert off.stage is None
    assert off.slots == 3
    assert [name for name, _ in off.named_parameters()] == ["nothing"]
