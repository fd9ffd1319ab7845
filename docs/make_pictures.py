"""Draws the pictures of the README and the docs from real episodes.

Run it with: .venv/bin/python docs/make_pictures.py
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from hide_tasks import ALL_TASKS, suite
from hide_tasks.bullet.cameras import camera
from hide_tasks.bullet.world import World
from hide_tasks.contract import EpisodeSpec
from hide_tasks.script import script

FOLDER = Path(__file__).parent / "pictures"
SIZE = 384
CAPTION = 34
INK, PAPER = (40, 40, 44), (255, 255, 255)
ORIGINS = {"top": (217, 154, 94), "bottom": (84, 132, 176)}

Picture = NDArray[np.uint8]


def frames(spec: EpisodeSpec, moments: list[int], view: str, size: int) -> list[Picture]:
    """What a camera sees after so many keyframes of the expert; -1 is the end."""
    found: dict[int, Picture] = {}
    with World(suite.build(spec)) as world:

        def look() -> Picture:
            cameras = [camera(view, size, size)]
            images = world.renderer.render(cameras, world.poses(), supersample=2)
            return np.asarray(images.rgb[0])

        for done, (_, keyframe) in enumerate(script(world.task)):
            if done in moments:
                found[done] = look()
            world.execute(keyframe)
        found[-1] = look()
    return [found[moment] for moment in moments]


def labelled(
    image: Image.Image, at: tuple[int, int], text: str, ink: tuple[int, ...] = INK
) -> None:
    """Write a line of text centred at a point."""
    font = ImageFont.load_default(size=17)
    ImageDraw.Draw(image).text(at, text, fill=ink, font=font, anchor="mm")


def same_picture_other_action() -> Image.Image:
    """Two episodes that began differently, look the same now, and must go on differently."""
    sheet = Image.new("RGB", (2 * SIZE + 12, 2 * (SIZE + CAPTION) + CAPTION), PAPER)
    spec = suite.episode("reopen_drawer", "val", 4)
    for column, (origin, ink) in enumerate(ORIGINS.items()):
        left = column * (SIZE + 12)
        start, now = frames(spec.twin({"origin": origin}), [0, 6], "left_shoulder", SIZE)
        sheet.paste(Image.fromarray(start), (left, CAPTION))
        sheet.paste(Image.fromarray(now), (left, SIZE + 2 * CAPTION))
        middle = left + SIZE // 2
        labelled(sheet, (middle, CAPTION // 2), f"at the start: the {origin} drawer is open")
        labelled(sheet, (middle, SIZE + CAPTION * 3 // 2), "now: the button is pressed, all shut")
        below = sheet.height - CAPTION // 2
        labelled(sheet, (middle, below), f"next: open the {origin} drawer", ink)
    return sheet


def contact_sheet() -> Image.Image:
    """Start, middle and end of an expert's episode of every task."""
    size = 224
    sheet = Image.new("RGB", (3 * size, len(ALL_TASKS) * (size + CAPTION)), PAPER)
    for row, name in enumerate(ALL_TASKS):
        top = row * (size + CAPTION)
        labelled(sheet, (sheet.width // 2, top + CAPTION // 2), name)
        pictures = frames(suite.episode(name, "val", 0), [0, 4, -1], "right_shoulder", size)
        for column, picture in enumerate(pictures):
            sheet.paste(Image.fromarray(picture), (column * size, top + CAPTION))
    return sheet


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    same_picture_other_action().save(FOLDER / "same_picture.png", optimize=True)
    contact_sheet().save(FOLDER / "tasks.png", optimize=True)
