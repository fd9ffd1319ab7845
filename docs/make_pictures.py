"""Draws the pictures of the README, the docs and the pages from real episodes.

Run it with: .venv/bin/python docs/make_pictures.py
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from docs.make_pages import sheet
from hide_tasks import ALL_TASKS, SUITES, load, suite
from hide_tasks.bullet.cameras import Camera, camera, looking
from hide_tasks.bullet.world import World
from hide_tasks.certificate import ALIAS_EPISODES
from hide_tasks.certificates import committed
from hide_tasks.contract import EpisodeSpec
from hide_tasks.script import script
from hide_tasks.task import Alias

FOLDER = Path(__file__).parent / "pictures"
PAGES = Path(__file__).parent.parent / "web" / "static" / "tasks"
SIZE = 384
CAPTION = 34
INK, PAPER = (40, 40, 44), (255, 255, 255)
ORIGINS = {"top": (217, 154, 94), "bottom": (84, 132, 176)}

LARGE = 512
THUMB, GAP, COLUMNS = 176, 16, 3  # of the contact sheet, pixels
QUALITY = 82  # of WebP; keeps every picture under 40 KB
EYE, EYE_TARGET = np.array((-0.28, -1.42, 1.78)), np.array((0.13, -0.02, 0.97))  # m
EYE_ANGLE = 42.0  # degrees
ALIAS_VIEWS = {"push_button_times": "front"}  # else the right shoulder

Picture = NDArray[np.uint8]


def frames(spec: EpisodeSpec, moments: list[int], view: Camera) -> list[Picture]:
    """What a camera sees after so many keyframes of the expert; -1 is the end."""
    found: dict[int, Picture] = {}
    with World(suite.build(spec)) as world:

        def look() -> Picture:
            images = world.renderer.render([view], world.poses(), supersample=2)
            return np.asarray(images.rgb[0])

        for done, (_, keyframe) in enumerate(script(world.task)):
            if done in moments:
                found[done] = look()
            world.execute(keyframe)
        found[-1] = look()
    return [found[moment] for moment in moments]


def spectator(size: int) -> Camera:
    """A camera beside the robot that sees the whole table, the robot and the fronts of drawers."""
    focal = size / 2 / np.tan(np.radians(EYE_ANGLE / 2))
    intrinsics = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    return Camera(size, size, intrinsics, looking(EYE, EYE_TARGET - EYE))


def start_of(task: str) -> Image.Image:
    """The start of an episode as somebody in the room sees it."""
    with World(suite.build(suite.episode(task, "val", 0))) as world:
        images = world.renderer.render([spectator(LARGE)], world.poses(), supersample=3)
    return Image.fromarray(np.asarray(images.rgb[0]))


def alias_pictures(task: str, why: str) -> tuple[Image.Image, Image.Image]:
    """Both moments of an alias pair of the certificate, in the episode that it tells of."""
    spec, alias = example(task, why)
    seen = load(task).cameras
    view = ALIAS_VIEWS.get(task, "right_shoulder" if "right_shoulder" in seen else seen[0])
    first, second = (
        Image.fromarray(
            frames(spec.twin(moment.twin), [moment.keyframes], camera(view, SIZE, SIZE))[0]
        )
        for moment in (alias.first, alias.second)
    )
    return first, second


def example(task: str, why: str) -> tuple[EpisodeSpec, Alias]:
    """The first episode in which the pair was verified."""
    for spec in suite.episodes(task, "train", ALIAS_EPISODES):
        for alias in suite.build(spec).aliases():
            if alias.why == why:
                return spec, alias
    raise LookupError(f"No episode of {task} declares '{why}'; run `hide certify`.")


def draw_for_pages() -> None:
    """Write what the pages show of every task."""
    PAGES.mkdir(parents=True, exist_ok=True)
    for task in ALL_TASKS:
        save(start_of(task), PAGES / f"{task}.webp")
        for number, alias in enumerate(committed(task).get("aliases", []), start=1):
            pictures = alias_pictures(task, alias["why"])
            for side, picture in zip("ab", pictures, strict=True):
                save(picture, PAGES / f"{task}-alias-{number}-{side}.webp")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture small enough for a page."""
    picture.save(path, quality=QUALITY, method=6)


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
        view = camera("left_shoulder", SIZE, SIZE)
        start, now = frames(spec.twin({"origin": origin}), [0, 6], view)
        sheet.paste(Image.fromarray(start), (left, CAPTION))
        sheet.paste(Image.fromarray(now), (left, SIZE + 2 * CAPTION))
        middle = left + SIZE // 2
        labelled(sheet, (middle, CAPTION // 2), f"at the start: the {origin} drawer is open")
        labelled(sheet, (middle, SIZE + CAPTION * 3 // 2), "now: the button is pressed, all shut")
        below = sheet.height - CAPTION // 2
        labelled(sheet, (middle, below), f"next: open the {origin} drawer", ink)
    return sheet


def contact_sheet(tasks: Sequence[str]) -> Image.Image:
    """Start, middle and end of an expert's episode of every one of these tasks."""
    width, height = 3 * THUMB + GAP, THUMB + CAPTION
    rows = -(-len(tasks) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * width - GAP, rows * height), PAPER)
    for number, name in enumerate(tasks):
        row, column = divmod(number, COLUMNS)
        labelled(sheet, (column * width + 3 * THUMB // 2, row * height + CAPTION // 2), name)
        for place, picture in enumerate(start_middle_end(name)):
            at = (column * width + place * THUMB, row * height + CAPTION)
            sheet.paste(Image.fromarray(picture), at)
    return sheet


def start_middle_end(name: str) -> list[Picture]:
    """Three moments of the expert's longest episode in val."""
    keyframes = suite.committed(name)["splits"]["val"]["keyframes"]
    longest = max(range(len(keyframes)), key=lambda i: keyframes[i])
    moments = [0, keyframes[longest] // 2, -1]
    return frames(suite.episode(name, "val", longest), moments, spectator(THUMB))


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    same_picture_other_action().save(FOLDER / "same_picture.png", optimize=True)
    for name, tasks in SUITES.items():
        contact_sheet(tasks).save(FOLDER / sheet(name), optimize=True)
    draw_for_pages()
