"""Pictures of an episode, from its recording: what each camera saw, and an animated preview.

Nothing is stored: reading a recording takes 30 ms, and the last ones read are kept.
"""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from hide_tasks import load
from server.blobs import Blobs
from server.episodes import recording_of
from server.kept import Kept
from server.models import Episode
from server.problems import Problem, not_found

WEBP = "image/webp"
PREVIEW_CAMERA = "front"
KEPT_RECORDINGS = 32  # 150 kB of pictures each
KEPT_PREVIEWS = 512  # 12 kB each

Made = TypeVar("Made")


_seen: Kept[str, dict[str, dict[int, bytes]]] = Kept(KEPT_RECORDINGS)
_previews: Kept[str, bytes] = Kept(KEPT_PREVIEWS)


def preview(store: Blobs, episode: Episode) -> bytes:
    """An animated WebP of what the front camera saw, a frame a decision.

    Raises:
        Problem: 404, there is no recording, or none that can be read; 410, it was removed.
    """
    from workers.recording_pictures import pictures
    from workers.recording_pictures import preview as animated

    sha256 = _recording(store, episode)

    def made(path: Path) -> bytes:
        seen = pictures(path)
        if PREVIEW_CAMERA not in seen:
            raise not_found("preview of episode", episode.id)
        return animated(seen[PREVIEW_CAMERA])

    return _previews.kept(sha256, lambda: _read(store.path(sha256), made))


def observation(store: Blobs, episode: Episode, decision: int, camera: str) -> bytes:
    """A JPEG of what a camera saw before a decision; after the last one, of the end.

    Raises:
        Problem: 404, there is no such picture; it says which there are. 410, it was removed.
    """
    sha256 = _recording(store, episode)
    seen = _seen.kept(sha256, lambda: _read(store.path(sha256), _by_decision))
    found = seen.get(camera, {})
    if decision not in found:
        raise Problem(404, "not_found", _no_picture(episode.task, camera, decision, found))
    return found[decision]


def _no_picture(task: str, camera: str, decision: int, found: Collection[int]) -> str:
    cameras = load(task).cameras
    if camera not in cameras:
        return f"{task} has no camera {camera}; it is seen through {', '.join(cameras)}."
    known = f"0 to {max(found)}" if found else "none"
    return f"The {camera} camera has no picture of decision {decision}; there are {known}."


def _by_decision(path: Path) -> dict[str, dict[int, bytes]]:
    """Per camera, the first picture of each decision."""
    from workers.recording_pictures import pictures

    return {
        camera: {one.decision: one.jpeg for one in reversed(found)}
        for camera, found in pictures(path).items()
    }


def _recording(store: Blobs, episode: Episode) -> str:
    sha256 = recording_of(episode)
    if sha256 is None or not store.holds(sha256):
        raise not_found("recording of episode", episode.id)
    return sha256


def _read(path: Path, how: Callable[[Path], Made]) -> Made:
    try:
        return how(path)
    except (OSError, ValueError, RuntimeError) as error:
        detail = f"The recording's pictures cannot be read: {error}"
        raise Problem(404, "unreadable_recording", detail) from None
