"""What an instruction names is told with the pixels."""

import pytest
import torch

from seek_model.named_colors import channels, compared, named

MAROON, AZURE = [128 / 255, 0.0, 0.0, 1.0], [0.0, 128 / 255, 1.0, 1.0]
NONE = [0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("instruction", "told"),
    [
        ("push the maroon button 3 times", [MAROON, NONE]),
        ("Pour the azure cup into the MAROON cup", [AZURE, MAROON]),
        ("open the drawers and close the blackboard", [NONE, NONE]),
        ("azure, maroon and red", [AZURE, MAROON]),
    ],
)
def test_colours_are_told_in_the_order_in_which_they_are_named(
    instruction: str, told: list[list[float]]
) -> None:
    torch.testing.assert_close(named([instruction], 2), torch.tensor([told]))


def test_a_pixel_is_told_how_far_it_is_from_what_is_named() -> None:
    images = torch.rand(2, 3, 17, 4, 4)
    told = named(["the maroon one", "the open one"], 2)

    found = compared(images, told, red=(3, 13))

    assert found.shape[2] == 17 + channels(2, layers=2)
    assert torch.equal(found[:, :, :17], images)
    maroon = torch.tensor(MAROON[:3])[None, :, None, None]
    torch.testing.assert_close(found[0, :, 17:20], images[0, :, 3:6] - maroon)
    torch.testing.assert_close(found[0, :, 20:23], images[0, :, 13:16] - maroon)
    assert (found[0, :, 23] == 1).all()
    assert not found[0, :, 24:].any()  # no second colour
    assert not found[1, :, 17:].any()  # none at all


def test_a_pixel_of_that_colour_differs_by_nothing() -> None:
    told = named(["the azure one"], 1)
    images = torch.zeros(1, 1, 10, 1, 1)
    images[0, 0, 3:6, 0, 0] = torch.tensor(AZURE[:3])

    assert not compared(images, told, red=(3,))[0, 0, 10:13].any()
