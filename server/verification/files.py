"""The files that a ledger names: there, whole, and of the episode that names them?"""

from pathlib import Path
from typing import Any

from server import blobs
from server.blobs import Blobs
from server.models import Blob, Episode
from server.verification.findings import Findings
from workers.policies import hash_of_file

SAID = (
    "task",
    "split",
    "index",
    "instruction",
    "policy",
    "success",
    "exact",
    "failure",
    "decisions",
    "scene_hash",
)


def check_blob(blob: Blob, store: Blobs, findings: Findings, name: str = "") -> bool:
    """Notes a file that is gone or is not what its name says; true if it is."""
    path = store.path(blob.sha256)
    findings.files += 1
    try:
        size, sha256 = path.stat().st_size, hash_of_file(path)
    except OSError as error:
        findings.note(blob.sha256, name, "file", f"{blob.size} bytes", error.strerror)
        return False
    stored = {"size": blob.size, "sha256": blob.sha256}
    return findings.expect(blob.sha256, name, stored, {"size": size, "sha256": sha256})


def check_recording(path: Path, subject: str, stored: dict[str, Any], findings: Findings) -> None:
    """Notes what a recording says of its episode, and the results do not."""
    from workers.recording import properties_of  # brings Rerun along

    name = f"{stored['task']}-{stored['split']}-{stored['index']:03d}"
    try:
        said = properties_of(path)
    except Exception as error:  # whatever a file that is no recording makes of the reader
        line = " ".join(str(error).split())
        findings.note(subject, name, "recording", "a recording", f"unreadable: {line}")
        return
    wanted = {field: stored[field] for field in SAID if field in stored}
    found = {field: said.get(field) for field in wanted}
    found = {f"{field} in the recording": value for field, value in found.items()}
    wanted = {f"{field} in the recording": value for field, value in wanted.items()}
    findings.expect(subject, name, wanted, found)


def check_files(
    episode: Episode,
    result: dict[str, Any],
    named: dict[str, Blob],
    store: Blobs,
    findings: Findings,
) -> None:
    """An episode's recording and thumbnail."""
    for sha256, media_type in ((episode.recording, blobs.RRD), (episode.thumbnail, blobs.JPEG)):
        if sha256 is None or (episode.removal and sha256 == episode.recording):
            continue
        blob = named.get(sha256)
        if blob is None:
            findings.note(episode.id, "", media_type, sha256, None)
            continue
        good = check_blob(blob, store, findings, f"{media_type} of {episode.id}")
        if good and media_type == blobs.RRD:
            check_recording(store.path(sha256), episode.id, result, findings)
