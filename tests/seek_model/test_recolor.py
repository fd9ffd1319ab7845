"""What is said and what is seen change together, and what nobody names stays."""

import numpy as np
import pytest

from hide_tasks.assets.colors import COLORS
from seek_model import recolor
from seek_model.language import KNOWN
from seek_model.recolor import NAMES, SAME, draw, orders, said, seen


def test_without_a_colour_there_is_one_order() -> None:
    assert orders("open the drawer again") == (SAME,)
    assert said("open the drawer again", SAME) == "open the drawer again"


@pytest.mark.parametrize(
    ("color", "others"),
    [
        ("red", {"red", "lime", "blue"}),
        ("maroon", {"maroon", "green", "navy"}),
        ("yellow", {"yellow", "cyan", "magenta"}),
        ("orange", {"orange", "rose", "azure", "violet"}),
        ("gray", {"gray"}),
    ],
)
def test_a_colour_becomes_those_of_its_kind(color: str, others: set[str]) -> None:
    text = f"push the {color} button 3 times"

    found = {said(text, order) for order in orders(text)}

    assert found == {f"push the {other} button 3 times" for other in others}


@pytest.mark.parametrize("color", COLORS)
@pytest.mark.parametrize("shade", [1.0, 0.4])
def test_what_is_seen_has_the_colour_that_is_said(color: str, shade: float) -> None:
    picture = (np.array([COLORS[color]]) * shade).astype(np.uint8)

    for order in orders(color):
        wanted = (np.array([COLORS[said(color, order)]]) * shade).astype(np.uint8)
        np.testing.assert_array_equal(seen(picture, order), wanted)


def test_several_colours_keep_apart() -> None:
    text = "put the red ring on the orange peg"
    for order in orders(text):
        words = said(text, order).split()
        assert words[2] in ("red", "lime", "blue")
        assert words[6] in ("orange", "rose", "azure", "violet")
    assert len(orders(text)) == 4


def test_what_is_nearly_grey_stays() -> None:
    table, arm, shadow = [200, 180, 155], [230, 232, 235], [12, 12, 12]
    picture = np.array([table, arm, shadow], np.uint8)
    np.testing.assert_array_equal(seen(picture, (2, 0, 1)), picture)


def test_every_order_is_drawn_as_often() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw(rng, "push the red button") for _ in range(1200)]
    counts = [drawn.count(order) for order in orders("push the red button")]
    assert len(counts) == 6
    assert 150 < min(counts) <= max(counts) < 250


def test_every_name_is_a_word_that_the_reader_knows() -> None:
    assert set(NAMES.values()) == set(COLORS) <= set(KNOWN)
    assert recolor.SAME == (0, 1, 2)
